/**
 * Quantiles.
 *
 * @module
 */

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
