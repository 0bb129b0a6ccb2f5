/**
 * Rate limiting.
 *
 * @module
 */

/**
 * Wrap a function so that it is called after a pause, with the newest arguments given until then.
 *
 * @template {unknown[]} T
 * @param {(...newest: T) => void} act
 * @param {() => number} pause returns the milliseconds to wait
 * @returns {(...given: T) => void}
 */
export function throttled(act, pause) {
    let newest = null;
    return (...given) => {
        if (!newest) {
            setTimeout(() => {
                const latest = newest;
                newest = null;
                act(...latest);
            }, pause());
        }
        newest = given;
    };
}
