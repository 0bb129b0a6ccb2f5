/**
 * Asking before the page is left while something would be lost. Browsers on iPhones do not ask.
 *
 * @module
 */

/** @type {(isNeeded: () => boolean) => void} called when the user is about to leave */
export function askBeforeLeaving(isNeeded) {
    window.addEventListener("beforeunload", (event) => {
        if (isNeeded()) {
            event.preventDefault();
            event.returnValue = "older browsers need any text";
        }
    });
}
