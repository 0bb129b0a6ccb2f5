/**
 * The rotations of a `.pgs`; the twin of `formats/pgs_rotations.py`, which documents the grid.
 *
 * @module
 */

const HALVINGS = [0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0];
const COARSEST = 4;

/**
 * How often steps are halved, of the turn that tilts z and of the one about z.
 *
 * @param {Float64Array[]} logScales rounded ones, along x, y and z
 * @returns {{swing: Uint8Array, twist: Uint8Array}}
 */
export function finenessOf([xs, ys, zs]) {
    const halvings = (ratio) => HALVINGS.filter((bound) => bound <= ratio).length;
    const [swing, twist] = [new Uint8Array(xs.length), new Uint8Array(xs.length)];
    for (let i = 0; i < xs.length; i++) {
        swing[i] = halvings(Math.max(Math.abs(xs[i] - zs[i]), Math.abs(ys[i] - zs[i])));
        twist[i] = halvings(Math.abs(xs[i] - ys[i]));
    }
    return { swing, twist };
}

/**
 * The step of a turn.
 *
 * @param {number} fineness
 * @param {number} unit
 * @returns {number}
 */
export const stepOf = (fineness, unit) => unit * 2 ** (COARSEST - fineness);

/**
 * The unit quaternion w, x, y, z of a turn t about z and one that tilts z by p and r.
 *
 * @param {number} p
 * @param {number} r
 * @param {number} t
 * @returns {number[]}
 */
export function quaternionOf(p, r, t) {
    const [x, y] = [p + r * t, r - p * t];
    const length = Math.sqrt(1 + x * x + y * y + t * t);
    return [1 / length, x / length, y / length, t / length];
}
