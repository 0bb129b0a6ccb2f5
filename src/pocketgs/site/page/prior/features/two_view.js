/**
 * Two-view geometry: matches that one rigid motion explains; see `prior/features/two_view.py`.
 *
 * @module
 */

import { givenMotion, raysOf } from "./epipolar.js";
import { narrowed } from "./motion.js";
import { sampled } from "./sampled_motion.js";
import { positionsOf } from "./tracks.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("./finder.js").Features} Features
 * @typedef {import("./tracks.js").Matches} Matches
 */

/**
 * Match pairs of views and keep what one motion explains.
 *
 * @param {Camera[]} cameras of the views, whose poses may be wrong
 * @param {Features[]} features of the views
 * @param {[number, number][]} pairs
 * @param {import("./finder.js").FeatureFinder} finder
 * @param {Object} settings the settings' `two_view`
 * @param {(done: number, of: number) => Promise<void>} onPair called before each pair; rejects to stop
 * @returns {Promise<Matches[]>} of the pairs with matches
 */
export async function matchViews(cameras, features, pairs, finder, settings, onPair) {
    const matches = [];
    for (const [done, [first, second]] of pairs.entries()) {
        await onPair(done, pairs.length);
        const found = await finder.match(first, second);
        const [here, there] = positionsOf(features, { first, second, pairs: found });
        const tolerance = settings.verification * Math.max(features[first].grain, features[second].grain);
        const agrees = agreeing(cameras[first], cameras[second], here, there, tolerance, settings);
        matches.push({ first, second, pairs: found.filter((_, i) => agrees[i >> 1]) });
    }
    return matches.filter(({ pairs }) => pairs.length);
}

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
