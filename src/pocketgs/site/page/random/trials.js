/**
 * How often RANSAC samples (Fischler and Bolles 1981).
 *
 * @module
 */

/**
 * After so many trials one sample is without wrong data, with some confidence.
 *
 * @param {number} share of the data that is right
 * @param {number} sample how many of them a sample takes
 * @param {number} confidence below 1
 * @returns {number}
 */
export function trialsFor(share, sample, confidence) {
    return Math.log(1 - confidence) / Math.log1p(-Math.min(share ** sample, 1 - 1e-9));
}
