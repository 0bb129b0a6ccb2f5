/**
 * Rounding as Python and NumPy do it.
 *
 * @module
 */

/** The nearest integer, of two the even one. @type {(value: number) => number} */
export function roundedToEven(value) {
    const below = Math.floor(value);
    return value - below === 0.5 ? below + (below % 2 === 0 ? 0 : 1) : Math.round(value);
}
