/**
 * Local image detail; the twin of `prior/cloud/detail.py`.
 *
 * @module
 */

import { mirrored } from "../numbers/mirrored.js";

/**
 * Local contrast: RMS, over a Gaussian window, of the difference from the image blurred with that window.
 *
 * @param {import("../capture/photograph.js").Frame} frame
 * @param {number} scale standard deviation of the window in pixels
 * @returns {Float32Array} (H, W) in [0, 1]; 0 where brightness is constant
 */
export function detailOf({ camera, rgba }, scale) {
    const brightness = new Float32Array(rgba.length / 4);
    for (let i = 0; i < brightness.length; i++) {
        brightness[i] = (rgba[4 * i] + rgba[4 * i + 1] + rgba[4 * i + 2]) / 3 / 255;
    }
    const smooth = blurred(brightness, camera, scale);
    return blurred(brightness.map((value, i) => (value - smooth[i]) ** 2), camera, scale).map(Math.sqrt);
}

/** With OpenCV's window, mirrored at the border without repeating it. */
function blurred(values, { width, height }, scale) {
    const weights = windowOf(scale);
    const across = filtered(values, weights, height, width, width, 1);
    return filtered(across, weights, width, height, 1, width);
}

/** Filter `lines` lines of `length` values, which are `step` apart; lines begin `stride` apart. */
function filtered(values, weights, lines, length, stride, step) {
    const result = new Float32Array(values.length);
    const reach = (weights.length - 1) / 2;
    for (let line = 0; line < lines; line++) {
        for (let i = 0; i < length; i++) {
            let sum = 0;
            for (let j = -reach; j <= reach; j++) {
                sum += weights[reach + j] * values[line * stride + mirrored(i + j, length) * step];
            }
            result[line * stride + i * step] = sum;
        }
    }
    return result;
}

/** OpenCV's window for floats reaches four standard deviations, with an odd number of pixels. */
function windowOf(scale) {
    const reach = Math.round(8 * scale + 1) >> 1;
    const weights = Array.from({ length: 2 * reach + 1 }, (_, i) => Math.exp(-((i - reach) ** 2) / (2 * scale ** 2)));
    const sum = weights.reduce((total, weight) => total + weight, 0);
    return weights.map((weight) => weight / sum);
}
