/**
 * Vectors of three and unit quaternions (w, x, y, z) as plain arrays.
 *
 * @module
 */

/**
 * @typedef {[number, number, number]} Vector
 * @typedef {[number, number, number, number]} Quaternion
 */

/** @type {(a: Vector, b: Vector) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @type {(a: Vector) => number} */
export const length = (a) => Math.hypot(...a);

/** `a + factor * b`. @type {(a: Vector, b: Vector, factor?: number) => Vector} */
export const add = (a, b, factor = 1) => [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]];

/** @type {(a: Vector, b: Vector) => Vector} */
export const subtract = (a, b) => add(a, b, -1);

/** @type {(a: Vector, b: Vector) => Vector} */
export const cross = (a, b) => [
    a[1] * b[2] - a[2] * b[1],
    a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0],
];

/** Normalise; a zero vector stays as it is. @type {(a: Vector) => Vector} */
export const normalised = (a) => a.map((value) => value / (length(a) || 1));

/** Interpolate linearly from `a` (0) to `b` (1). @type {(a: number[], b: number[], share: number) => number[]} */
export const mix = (a, b, share) => a.map((value, i) => value + share * (b[i] - value));

/** Product: rotates by `q`, then by `p`. @type {(p: Quaternion, q: Quaternion) => Quaternion} */
export const product = (p, q) => [
    p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
    p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
    p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
    p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
];

/** Rotation about a unit vector. @type {(axis: Vector, angle: number) => Quaternion} */
export const turn = (axis, angle) => {
    const s = Math.sin(angle / 2);
    return [Math.cos(angle / 2), s * axis[0], s * axis[1], s * axis[2]];
};

/** Normalise. @type {(q: Quaternion) => Quaternion} */
export const unit = (q) => q.map((value) => value / Math.hypot(...q));

/** Images of the x, y and z axes under a rotation. @type {(q: Quaternion) => [Vector, Vector, Vector]} */
export function axesOf([w, x, y, z]) {
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ];
}

/** The rotation that maps x, y and z to these axes. @type {(axes: [Vector, Vector, Vector]) => Quaternion} */
export function rotationTo([a, b, c]) {
    // Rows are 4 w, 4 x, 4 y or 4 z times the quaternion: the one of the largest avoids cancellation.
    const rows = [
        [1 + a[0] + b[1] + c[2], b[2] - c[1], c[0] - a[2], a[1] - b[0]],
        [b[2] - c[1], 1 + a[0] - b[1] - c[2], a[1] + b[0], c[0] + a[2]],
        [c[0] - a[2], a[1] + b[0], 1 - a[0] + b[1] - c[2], b[2] + c[1]],
        [a[1] - b[0], c[0] + a[2], b[2] + c[1], 1 - a[0] - b[1] + c[2]],
    ];
    const largest = rows.reduce((best, row, i) => (row[i] > rows[best][best] ? i : best), 0);
    return unit(rows[largest]);
}

/** Interpolate from `p` to `q` at constant speed, the short way. @type {(p: Quaternion, q: Quaternion, share: number) => Quaternion} */
export function slerp(p, q, share) {
    const cosine = p.reduce((sum, value, i) => sum + value * q[i], 0);
    const angle = Math.acos(Math.min(Math.abs(cosine), 1));
    const towards = q.map((value) => (cosine < 0 ? -value : value));
    if (angle < 1e-4) {
        return unit(mix(p, towards, share));
    }
    const [from, to] = [Math.sin((1 - share) * angle), Math.sin(share * angle)];
    return unit(p.map((value, i) => from * value + to * towards[i]));
}
