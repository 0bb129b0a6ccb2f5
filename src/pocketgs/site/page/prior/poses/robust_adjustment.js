/**
 * Bundle adjustment to tracks with wrong observations: rounds of consensus and adjustment, with a falling tolerance; the
 * twin of `prior/poses/robust_adjustment.py`.
 *
 * @module
 */

import { adjustBundle } from "../bundle/adjustment.js";
import { countsOf, enoughForEachView, filtered, pointsOf, renumbered } from "../features/observations.js";
import { triangulate } from "../features/tracks.js";
import { consensus } from "./consensus.js";
import { wellSupported } from "./support.js";
import { nextTolerance } from "./tolerance.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 *
 * @typedef {Object} Adjusted
 * @property {Camera[]} cameras adjusted where supported, otherwise as given
 * @property {boolean[]} supported for each camera whether it sees enough points
 * @property {number} tolerance maximum error of an observation under the new poses, in pixels
 */

/**
 * Adjust cameras to those of the observations that agree.
 *
 * @param {Camera[]} given
 * @param {Observations} tracks sorted by point, including wrong ones
 * @param {number} tolerance maximum error of an observation under the given poses, in pixels
 * @param {number} finest errors below this many pixels are noise
 * @param {Object} settings the settings' `poses`, with the `bundle` settings of this scene
 * @returns {Adjusted}
 */
export function adjustedTo(given, tracks, tolerance, finest, settings) {
    let [cameras, supported] = [given, given.map(() => false)];
    for (let round = 0; round < settings.rounds; round++) {
        const { agrees } = consensus(cameras, tracks, tolerance, settings);
        const chosen = wellSeen(given, filtered(tracks, (i) => agrees[i]), settings);
        ({ supported } = chosen);
        if (!supported.some(Boolean)) {
            return { cameras: given, supported, tolerance };
        }
        let seen = renumbered(chosen.tracks);
        const points = triangulate(cameras, seen, settings);
        seen = renumbered(filtered(seen, (i) => Number.isFinite(points[3 * seen.point[i]])));
        const result = adjustBundle(given, points.filter(Number.isFinite), seen, settings.bundle, cameras);
        cameras = given.map((camera, view) => (supported[view] ? result.cameras[view] : camera));
        const last = tolerance;
        tolerance = nextTolerance(result.residuals, tolerance, finest, settings);
        if (tolerance > 0.8 * last) {
            break;
        }
    }
    return { cameras, supported, tolerance };
}

/** Enough observations to adjust by, and which cameras have enough of them, well spread. */
function wellSeen(cameras, tracks, settings) {
    const { min_observations: least, observations_per_view: most } = settings;
    let supported = cameras.map(() => true);
    for (let isSettled = false; !isSettled; ) {
        tracks = filtered(tracks, (i) => supported[tracks.frame[i]]);
        const views = countsOf(tracks.point, pointsOf(tracks));
        tracks = filtered(tracks, (i) => views[tracks.point[i]] >= 2);
        const enough = wellSupported(cameras, tracks, least, settings);
        const before = supported;
        supported = before.map((was, view) => was && enough[view]);
        isSettled = supported.every((isSupported, view) => isSupported === before[view]);
    }
    const wanted = enoughForEachView(tracks, cameras.length, most);
    return { tracks: filtered(tracks, (i) => wanted[tracks.point[i]]), supported };
}
