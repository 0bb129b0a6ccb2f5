/**
 * Doing something so seldom that it holds nothing else up.
 *
 * @module
 */

/**
 * A function that calls another one a while later, with the newest of what it has been given until then.
 *
 * @template {unknown[]} T
 * @param {(...newest: T) => void} act
 * @param {() => number} pause milliseconds to let go by first
 * @returns {(...given: T) => void}
 */
export function paced(act, pause) {
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
