/**
 * Keeps the screen on while a capture trains: a phone that sleeps stops the page.
 *
 * @module
 */

let isWanted = false;
/** @type {WakeLockSentinel | null} */
let held = null;

/** @type {(wanted: boolean) => void} */
export function keepAwake(wanted) {
    isWanted = wanted;
    update();
}

/** The browser takes the lock back when the page is hidden. */
document.addEventListener("visibilitychange", update);

async function update() {
    if (isWanted && document.visibilityState === "visible" && (held?.released ?? true)) {
        // Refused on a low battery, and missing in some browsers: then the screen is left to its settings.
        held = (await navigator.wakeLock?.request("screen").catch(() => null)) ?? null;
    }
    if (!isWanted) {
        held?.release();
        held = null;
    }
}
