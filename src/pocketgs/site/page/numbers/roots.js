/**
 * Real roots of polynomials.
 *
 * @module
 */

/** Halvings of an interval: as many as a number has digits. */
const HALVINGS = 53;

/**
 * The roots in an interval at which the polynomial changes its sign. Between two neighbouring extrema there is one at
 * most; these are the roots of the derivative.
 *
 * @param {number[]} coefficients of powers from 0
 * @param {number} low
 * @param {number} high
 * @returns {number[]} ascending
 */
export function rootsBetween(coefficients, low, high) {
    if (coefficients.length < 2) {
        return [];
    }
    const slopes = coefficients.slice(1).map((coefficient, i) => (i + 1) * coefficient);
    const ends = [low, ...rootsBetween(slopes, low, high), high];
    const isPositive = (at) => valueAt(coefficients, at) > 0;
    return ends.slice(1).flatMap((end, i) => {
        return isPositive(ends[i]) === isPositive(end) ? [] : [changeBetween(isPositive, ends[i], end)];
    });
}

const valueAt = (coefficients, at) => coefficients.reduceRight((sum, coefficient) => sum * at + coefficient, 0);

function changeBetween(test, low, high) {
    const atLow = test(low);
    for (let halving = 0; halving < HALVINGS; halving++) {
        const middle = (low + high) / 2;
        [low, high] = test(middle) === atLow ? [middle, high] : [low, middle];
    }
    return (low + high) / 2;
}
