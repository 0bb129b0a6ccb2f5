/**
 * Two-view geometry: matches that one rigid motion explains; see `prior/features/two_view.py`.
 *
 * @module
 */

import { givenMotion, raysOf } from "./epipolar.js";
import { narrowed } from "./motion.js";
import { sampled } from "./sampled_motion.js";

/** @typedef {import("../../capture/camera.js").Camera} Camera */

/**
 * The matches that agree with one motion: one near the given poses, or another one that more of them agree with.
 *
 * @param {Camera} first
 * @param {Camera} second
 * @param {Float64Array} here (M, 2) pixels in the first view
 * @param {Float64Array} there (M, 2) pixels in the second
 * @param {number} tolerance distance from epipolar lines in pixels
 * @param {Object} settings the settings' `two_view`
 * @returns {Uint8Array} (M,) all 0 if too few agree
 */
export function agreeing(first, second, here, there, tolerance, settings) {
    const count = here.length / 2;
    const nothing = new Uint8Array(count);
    if (count < settings.min_matches) {
        return nothing;
    }
    const rays = raysOf(first, second, here, there);
    const widest = settings.widest * Math.max(first.width, first.height);
    const agrees = sampled(rays, tolerance, narrowed(givenMotion(first, second), rays, widest, tolerance), settings);
    const enough = Math.max(settings.min_matches, settings.min_share * count);
    return agrees.reduce((sum, flag) => sum + flag, 0) >= enough ? agrees : nothing;
}
