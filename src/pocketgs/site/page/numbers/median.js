/**
 * Medians.
 *
 * @module
 */

/** The middle number, or the mean of the two in the middle. @type {(values: ArrayLike<number>) => number} */
export const medianOf = (values) => middleOf(Float64Array.from(values).sort());

/** The same of numbers that are sorted. @type {(sorted: ArrayLike<number>) => number} */
export function middleOf(sorted) {
    const half = sorted.length / 2;
    return (sorted[Math.ceil(half) - 1] + sorted[Math.floor(half)]) / 2;
}
