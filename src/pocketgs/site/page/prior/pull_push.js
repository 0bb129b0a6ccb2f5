/**
 * Interpolation of what is unknown from its surroundings, smoothly, from coarse to fine; see `prior/cloud/complete.py`.
 *
 * @module
 */

import { areaAveraged, interpolated } from "../numbers/resizing.js";

/**
 * Values where weights are 1, elsewhere from a smaller copy (Gortler et al. 1996).
 *
 * @param {Float32Array} values (H, W)
 * @param {Float32Array} weights (H, W) 0 or 1
 * @param {{width: number, height: number}} size
 * @returns {Float32Array} (H, W)
 */
export function pulled(values, weights, size) {
    if (values.length === 1 || weights.every((weight) => weight > 0)) {
        return values;
    }
    const half = { width: Math.max(1, (size.width + 1) >> 1), height: Math.max(1, (size.height + 1) >> 1) };
    const mass = areaAveraged(weights, 1, size, half);
    const sums = areaAveraged(values.map((value, i) => value * weights[i]), 1, size, half);
    const mean = sums.map((sum, i) => sum / Math.max(mass[i], 1e-9));
    const coarse = pulled(mean, mass.map((one) => Number(one > 0)), half);
    const smooth = interpolated(coarse, half, size);
    return values.map((value, i) => (weights[i] > 0 ? value : smooth[i]));
}
