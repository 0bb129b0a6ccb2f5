/**
 * Elements of the page.
 *
 * @module
 */

/** @type {(id: string) => HTMLElement | null} */
export function element(id) {
    return document.getElementById(id);
}
