/**
 * Rotations, as 3 x 3 matrices row by row and as vectors along the axis whose length is the angle.
 *
 * @module
 */

const AXES = [0, 1, 2];

/** The product of two 3 x 3 matrices. @type {(a: ArrayLike<number>, b: ArrayLike<number>) => number[]} */
export function product(a, b) {
    return AXES.flatMap((i) => AXES.map((j) => a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j]));
}

/** The transpose of a 3 x 3 matrix. @type {(a: ArrayLike<number>) => number[]} */
export const transposed = (a) => AXES.flatMap((i) => AXES.map((j) => a[3 * j + i]));

/** The rotation of a vector (Rodrigues). @type {(vector: ArrayLike<number>) => number[]} */
export function rotationAbout([x, y, z]) {
    const angle = Math.hypot(x, y, z);
    // Their limits for small angles, where the quotients lose their digits.
    const sine = angle > 1e-8 ? Math.sin(angle) / angle : 1;
    const rest = angle > 1e-8 ? (1 - Math.cos(angle)) / angle ** 2 : 0.5;
    const crossed = [0, -z, y, z, 0, -x, -y, x, 0];
    const squared = product(crossed, crossed);
    return crossed.map((value, i) => (i % 4 ? 0 : 1) + sine * value + rest * squared[i]);
}

/** The vector of a rotation by less than half a turn. @type {(rotation: ArrayLike<number>) => number[]} */
export function vectorOf(r) {
    const twice = [r[7] - r[5], r[2] - r[6], r[3] - r[1]];
    const sine = Math.hypot(...twice) / 2;
    const angle = Math.atan2(sine, (r[0] + r[4] + r[8] - 1) / 2);
    const scale = sine > 1e-8 ? angle / (2 * sine) : 0.5;
    return twice.map((value) => scale * value);
}
