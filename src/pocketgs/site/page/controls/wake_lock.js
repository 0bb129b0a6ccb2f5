/**
 * Keeps the screen on while a capture trains: a phone that sleeps stops the page.
 *
 * @module
 */

let isWanted = false;
/** @type {WakeLockSentinel | null} */
let held = null;
/** Until all that was wanted so far is done: one request at a time, or a lock would be lost sight of. */
let updating = Promise.resolve();

/** @type {(wanted: boolean) => void} */
export function keepAwake(wanted) {
    isWanted = wanted;
    updateNext();
}

/** The browser takes the lock back when the page is hidden. */
document.addEventListener("visibilitychange", updateNext);

function updateNext() {
    updating = updating.then(update);
}

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
