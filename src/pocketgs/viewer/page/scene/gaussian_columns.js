/**
 * A scene in the shaders' layout, column by column; the twin of `scene_columns.py`.
 *
 * @module
 */

import { MAX_BYTES, QUATERNION, SH_DC, SHAPE_COLUMNS } from "../constants.js";

/** Smallest standard deviation that float32 holds in full precision: shaders draw finite logarithms only. */
export const MIN_SCALE = 2 ** -126;

/** Coefficient of degree 0 of a colour in [0, 1]. @type {(colour: number) => number} */
export const dcOf = (colour) => (colour - 0.5) / SH_DC;

/**
 * Check the memory that a scene needs before it is allocated: a file can state any number.
 *
 * @param {number} count
 * @param {number} coefficients
 * @param {number} unpacked bytes of the decompressed file, in addition to the scene
 * @throws {Error} it exceeds the maximum
 */
export function requireRoom(count, coefficients, unpacked = 0) {
    const needed = 4 * (SHAPE_COLUMNS + 3 * coefficients) * count + unpacked;
    if (needed > MAX_BYTES) {
        const [found, most] = [needed, MAX_BYTES].map((bytes) => Math.ceil(bytes / 1e6).toLocaleString("en"));
        throw new Error(`${count.toLocaleString("en")} Gaussians would take ${found} MB, expected at most ${most} MB`);
    }
}

/** N Gaussians with K spherical-harmonics coefficients per channel. */
export class GaussianColumns {
    /**
     * @param {number} count
     * @param {number} coefficients 1, 4, 9 or 16
     */
    constructor(count, coefficients) {
        requireRoom(count, coefficients);
        this.count = count;
        this.coefficients = coefficients;
        /** (11, N): mean, log scale, quaternion of unit length, opacity logit. */
        this.shape = new Float32Array(SHAPE_COLUMNS * count);
        /** (3 K, N): coefficient by coefficient, RGB each. */
        this.sh = new Float32Array(3 * coefficients * count);
        /** @type {import("./weighting.js").Weighting | null} of a scene that is drawn without sorting */
        this.weighting = null;
        /** Whether it was trained with anti-aliasing, without which it is drawn. */
        this.isAntialiased = false;
        /** Size of the user's file that it was read from, or 0 where it is not known. */
        this.fileBytes = 0;
    }

    /**
     * @param {number} column of `shape`
     * @returns {Float32Array} a view of its N numbers
     */
    column(column) {
        return this.shape.subarray(column * this.count, (column + 1) * this.count);
    }

    /**
     * @param {number} coefficient
     * @param {number} channel
     * @returns {Float32Array} a view of N numbers
     */
    harmonics(coefficient, channel) {
        const column = 3 * coefficient + channel;
        return this.sh.subarray(column * this.count, (column + 1) * this.count);
    }

    /** Normalise the quaternions; those of length 0 become the identity. */
    normaliseQuaternions() {
        const [w, x, y, z] = [0, 1, 2, 3].map((part) => this.column(QUATERNION + part));
        for (let i = 0; i < this.count; i++) {
            const length = Math.hypot(w[i], x[i], y[i], z[i]);
            if (length === 0) {
                w[i] = 1;
            } else if (Math.abs(length - 1) > 1e-6) {
                w[i] /= length;
                x[i] /= length;
                y[i] /= length;
                z[i] /= length;
            }
        }
    }
}
