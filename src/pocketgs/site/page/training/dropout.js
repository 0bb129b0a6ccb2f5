/**
 * Dropout where few photographs show the scene; the twin of `training/dropout.py`.
 *
 * @module
 */

import { isInImage, projected } from "../capture/camera.js";
import { medianOf } from "../numbers/quantiles.js";

/**
 * Median over the points of the number of cameras whose image contains the point.
 *
 * @param {import("../capture/camera.js").Camera[]} cameras
 * @param {Float64Array} positions (N, 3) of the points
 * @param {number} most number of points that it is the median of at most
 * @returns {number}
 */
export function viewsPerPoint(cameras, positions, most) {
    const views = [];
    const stride = 3 * (1 + Math.floor(positions.length / 3 / most));
    for (let i = 0; i < positions.length; i += stride) {
        const [x, y, z] = positions.subarray(i, i + 3);
        views.push(cameras.filter((camera) => isInImage(camera, projected(camera, x, y, z))).length);
    }
    return views.length ? medianOf(views) : 0;
}

/**
 * The share of Gaussians that steps leave out.
 *
 * @param {{most: number, few_views: number, enough_views: number}} dropout
 * @param {number} views from `viewsPerPoint`
 * @returns {number}
 */
export function dropoutShare({ most, few_views: few, enough_views: enough }, views) {
    return most * Math.min(Math.max((enough - views) / (enough - few), 0), 1);
}

/**
 * Fields of the struct `View` for a step.
 *
 * @param {number} share from `dropoutShare`
 * @param {number} iteration counted from 1
 * @param {number} seed random seed of the run
 * @returns {{dropout_threshold: number, dropout_seed: number}}
 */
export function dropoutOfStep(share, iteration, seed) {
    const stepSeed = (Math.imul(0x9e3779b9, seed) + iteration) >>> 0;
    return { dropout_threshold: Math.floor(share * 2 ** 32), dropout_seed: stepSeed };
}
