/**
 * The near plane; the twin of `splat/near_plane.py`.
 *
 * @module
 */

import { NEAR, NEAR_SAMPLES } from "../constants.js";

/**
 * Minimum depth of the centre of a Gaussian to be drawn, in proportion to the scene.
 *
 * @param {Float32Array[]} means x, y and z of the Gaussians, N each
 * @param {number} count number of those that have arrived
 * @returns {number}
 */
export function nearPlane(means, count) {
    const step = Math.max(1, Math.ceil(count / NEAR_SAMPLES));
    const sample = [];
    for (let i = 0; i < count; i += step) {
        const mean = means.map((column) => column[i]);
        if (mean.every(Number.isFinite)) {
            sample.push(mean);
        }
    }
    const middle = [0, 1, 2].map((axis) => upperMedianOf(sample.map((mean) => mean[axis])));
    const extent = upperMedianOf(sample.map((mean) => Math.max(...mean.map((value, axis) => Math.abs(value - middle[axis])))));
    return extent > 0 ? NEAR * 2 ** Math.round(Math.log2(extent)) : NEAR;
}

/** @param {number[]} numbers */
function upperMedianOf(numbers) {
    return Float64Array.from(numbers).sort()[numbers.length >> 1];
}
