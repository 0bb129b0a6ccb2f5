/**
 * Medians and other quantiles.
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

/**
 * Between the two nearest of the sorted numbers, interpolated linearly.
 *
 * @param {ArrayLike<number>} sorted
 * @param {number} share from 0 to 1
 * @returns {number}
 */
export function quantileOf(sorted, share) {
    const place = share * (sorted.length - 1);
    const below = Math.floor(place);
    const above = Math.min(below + 1, sorted.length - 1);
    return sorted[below] + (place - below) * (sorted[above] - sorted[below]);
}
