/**
 * The columns of a `.pgs`'s attributes; the twin of `formats/pgs_attributes.py`.
 *
 * @module
 */

const WINDOW = 16;
const MAX_SIZE = 127;
const MAX_FLATNESS = 15;
const MAX_TILT = 7;
const [RED, GREEN, BLUE] = [0, 1, 2];

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
 * @param {import("./range_decoder.js").RangeDecoder} coder
 * @param {Int32Array} coarseness
 * @returns {Int32Array[]}
 */
export function readScales(coder, coarseness) {
    const y = coder.column(coarseness);
    const least = y.reduce((sum, value) => Math.min(sum, value), y[0]);
    const flatness = coder.column(y.map((value) => Math.min(value - least, MAX_SIZE)));
    const shapes = flatness.map((value) => Math.max(-MAX_FLATNESS, Math.min(value, MAX_FLATNESS)) + MAX_FLATNESS);
    const x = coder.column(shapes).map((value, i) => y[i] - value);
    return [x, y, flatness.map((value, i) => y[i] - value)];
}

/**
 * Levels of the turns p, r and t.
 *
 * @param {import("./range_decoder.js").RangeDecoder} coder
 * @param {{swing: Uint8Array, twist: Uint8Array}} fineness
 * @returns {Int32Array[]}
 */
export function readTurns(coder, { swing, twist }) {
    const p = coder.column(swing);
    const contexts = swing.map((fine, i) => fine * (MAX_TILT + 1) + Math.min(Math.abs(p[i]) >> fine, MAX_TILT));
    return [p, coder.column(contexts), coder.column(twist)];
}

/**
 * Levels of red, green and blue of degree 0.
 *
 * @param {import("./range_decoder.js").RangeDecoder} coder
 * @param {number} count
 * @param {Int32Array} neighbours
 * @returns {Int32Array[]}
 */
export function readColours(coder, count, neighbours) {
    const nothing = new Uint8Array(count);
    const green = coder.column(nothing, undefined, neighbours);
    const red = coder.column(nothing, undefined, neighbours).map((value, i) => green[i] + value);
    const blue = coder.column(nothing, undefined, neighbours).map((value, i) => green[i] + value);
    return [red, green, blue];
}

/**
 * Levels of a codebook's entries, or of all Gaussians: by coefficient above degree 0 and channel, one column each.
 *
 * @param {import("./range_decoder.js").RangeDecoder} coder
 * @param {number} count
 * @param {number} coefficients
 * @returns {Int32Array[][]}
 */
export function readHarmonics(coder, count, coefficients) {
    const nothing = new Uint8Array(count);
    return Array.from({ length: coefficients }, () => {
        const channels = [];
        channels[GREEN] = coder.column(nothing);
        const seen = channels[GREEN].map((value) => Math.min(Math.abs(value), 2));
        channels[RED] = coder.column(seen);
        channels[BLUE] = coder.column(seen.map((value, i) => value + 3 * Math.min(Math.abs(channels[RED][i]), 2)));
        return channels;
    });
}
