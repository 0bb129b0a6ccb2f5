/**
 * The columns of a `.pgs`'s attributes, and what is expected of each: reader and writer share this description; the
 * twin of `formats/pgs_attributes.py`.
 *
 * @module
 */

/**
 * @typedef {(values: ArrayLike<number>, contexts: ArrayLike<number>, neighbours?: Int32Array) => Int32Array} Code
 *     writes or reads the next column, and returns it; a reader ignores the values
 */

const WINDOW = 16;
const MAX_SIZE = 127;
const MAX_FLATNESS = 15;
const MAX_TILT = 7;

/**
 * Two indices per Gaussian of the nearest of the `WINDOW` before it; -1 for the first.
 *
 * @param {Int32Array[]} cells x, y and z
 * @returns {Int32Array}
 */
export function nearestBefore([xs, ys, zs]) {
    const found = new Int32Array(2 * xs.length).fill(-1);
    for (let i = 1; i < xs.length; i++) {
        let nearest = -1;
        let next = -1;
        let best = Infinity;
        let second = Infinity;
        for (let other = i - 1; other >= Math.max(i - WINDOW, 0); other--) {
            const x = xs[i] - xs[other];
            const y = ys[i] - ys[other];
            const z = zs[i] - zs[other];
            const apart = x * x + y * y + z * z;
            if (apart < best) {
                second = best;
                next = nearest;
                best = apart;
                nearest = other;
            } else if (apart < second) {
                second = apart;
                next = other;
            }
        }
        found[2 * i] = nearest;
        found[2 * i + 1] = next < 0 ? nearest : next;
    }
    return found;
}

/**
 * Per Gaussian one more than the trailing zero bits that its three coordinates share, or 0 if all are 0.
 *
 * @param {Int32Array[]} cells x, y and z
 * @returns {Int32Array}
 */
export function coarsenessOf([xs, ys, zs]) {
    return xs.map((x, i) => {
        const together = x | ys[i] | zs[i];
        return together ? 32 - Math.clz32(together & -together) : 0;
    });
}

/**
 * Levels of log scales along x, y and z.
 *
 * @param {Code} code
 * @param {Int32Array[]} table
 * @param {Int32Array} coarseness
 * @returns {Int32Array[]}
 */
export function codeScales(code, [xs, ys, zs], coarseness) {
    const y = code(ys, coarseness);
    const least = y.reduce((sum, value) => Math.min(sum, value), y[0]);
    const sizes = y.map((value) => Math.min(value - least, MAX_SIZE));
    const flatness = code(minus(ys, zs), sizes);
    const shapes = flatness.map((value) => Math.max(-MAX_FLATNESS, Math.min(value, MAX_FLATNESS)) + MAX_FLATNESS);
    return [minus(y, code(minus(ys, xs), shapes)), y, minus(y, flatness)];
}

/**
 * Levels of the turns p, r and t.
 *
 * @param {Code} code
 * @param {Int32Array[]} table
 * @param {{swing: Uint8Array, twist: Uint8Array}} fineness
 * @returns {Int32Array[]}
 */
export function codeTurns(code, [ps, rs, ts], { swing, twist }) {
    const p = code(ps, swing);
    const contexts = swing.map((fine, i) => fine * (MAX_TILT + 1) + Math.min(Math.abs(p[i]) >> fine, MAX_TILT));
    return [p, code(rs, contexts), code(ts, twist)];
}

/**
 * Levels of red, green and blue of degree 0.
 *
 * @param {Code} code
 * @param {Int32Array[]} table
 * @param {Int32Array} neighbours
 * @returns {Int32Array[]}
 */
export function codeColours(code, [reds, greens, blues], neighbours) {
    const nothing = new Uint8Array(greens.length);
    const green = code(greens, nothing, neighbours);
    const red = code(minus(reds, greens), nothing, neighbours);
    const blue = code(minus(blues, greens), nothing, neighbours);
    return [plus(red, green), green, plus(blue, green)];
}

/**
 * Levels of red, green and blue of one coefficient above degree 0, of a codebook's entries or of all Gaussians.
 *
 * @param {Code} code
 * @param {Int32Array[]} table
 * @returns {Int32Array[]}
 */
export function codeHarmonic(code, [reds, greens, blues]) {
    const green = code(greens, new Uint8Array(greens.length));
    const seen = green.map((value) => Math.min(Math.abs(value), 2));
    const red = code(reds, seen);
    return [red, green, code(blues, seen.map((value, i) => value + 3 * Math.min(Math.abs(red[i]), 2)))];
}

const plus = (some, others) => some.map((value, i) => value + others[i]);
const minus = (some, others) => some.map((value, i) => value - others[i]);
