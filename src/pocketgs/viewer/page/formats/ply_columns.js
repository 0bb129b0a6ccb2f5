/**
 * Which property of a `.ply` of the reference 3DGS implementation is which column of a scene.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../constants.js";

/**
 * @param {import("../scene/gaussian_columns.js").GaussianColumns} gaussians
 * @param {number} stored coefficients of each channel in the file, which may be more
 * @returns {Map<string, Float32Array>} views of their numbers, by the properties' names
 */
export function columnsOf(gaussians, stored = gaussians.coefficients) {
    const columns = new Map([["opacity", gaussians.column(OPACITY_LOGIT)]]);
    ["x", "y", "z"].forEach((name, axis) => columns.set(name, gaussians.column(MEAN + axis)));
    for (let axis = 0; axis < 3; axis++) {
        columns.set(`scale_${axis}`, gaussians.column(LOG_SCALE + axis));
        columns.set(`f_dc_${axis}`, gaussians.harmonics(0, axis));
    }
    for (let part = 0; part < 4; part++) {
        columns.set(`rot_${part}`, gaussians.column(QUATERNION + part));
    }
    for (let channel = 0; channel < 3; channel++) {
        for (let i = 1; i < gaussians.coefficients; i++) {
            columns.set(`f_rest_${channel * (stored - 1) + i - 1}`, gaussians.harmonics(i, channel));
        }
    }
    return columns;
}
