/**
 * The tolerance of reprojection errors, estimated from the data: between noise and the possible error of poses; the
 * twin of `prior/poses/tolerance.py`.
 *
 * @module
 */

import { medianOf } from "../../numbers/quantiles.js";
import { consensus } from "./consensus.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 */

/** Initial tolerance in pixels. @type {(cameras: Camera[], settings: {widest: number}) => number} */
export function widestTolerance(cameras, { widest }) {
    return widest * medianOf(cameras.map(({ width, height }) => Math.max(width, height)));
}

/**
 * The next tolerance, from the errors within the last one.
 *
 * @param {ArrayLike<number>} errors in pixels
 * @param {number} tolerance the last one
 * @param {number} finest lower bound
 * @param {{medians: number}} settings the settings' `poses`
 * @returns {number}
 */
export function nextTolerance(errors, tolerance, finest, { medians }) {
    const within = Array.from(errors).filter((error) => error < tolerance);
    return within.length ? Math.min(tolerance, Math.max(finest, medians * medianOf(within))) : tolerance;
}

/**
 * Estimate the tolerance under given poses: reduced from the widest as long as most errors stay within.
 *
 * @param {Camera[]} cameras
 * @param {Observations} tracks sorted by point
 * @param {number} finest lower bound in pixels
 * @param {Object} settings the settings' `poses`
 * @returns {number}
 */
export function measuredTolerance(cameras, tracks, finest, settings) {
    let tolerance = widestTolerance(cameras, settings);
    for (let round = 0; round < settings.tolerance_rounds; round++) {
        const { agrees, support, error } = consensus(cameras, tracks, tolerance, settings);
        const last = tolerance;
        tolerance = nextTolerance(error.filter((_, i) => agrees[i] && support[i] >= 2), tolerance, finest, settings);
        if (tolerance > 0.9 * last) {
            break;
        }
    }
    return tolerance;
}
