/**
 * Pose refinement: bundle adjustment over all frames, accepted only if validation shows that poses get better; the twin
 * of `prior/poses/refinement.py`.
 *
 * @module
 */

import { viewDistances } from "../features/pairs.js";
import { relativePose } from "../source_views.js";
import { adjustedTo } from "./robust_adjustment.js";
import { validated } from "./validation.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 * @typedef {import("../../capture/photograph.js").Frame} Frame
 */

/**
 * Adjust poses, component by component, and keep those that pass validation. Cameras that see too few points are moved
 * with the nearest refined one.
 *
 * @param {Camera[]} given
 * @param {Observations} tracks sorted by point, including wrong ones
 * @param {Frame[]} frames of the cameras, whose photographs count
 * @param {number} tolerance maximum error of an observation under the given poses, in pixels
 * @param {number} finest errors below this many pixels are noise
 * @param {Object} settings the settings' `poses`, with the `bundle` settings of this scene
 * @param {number} distance typical distance to the scene
 * @returns {Camera[]} the same objects as given where nothing is refined
 */
export function refine(given, tracks, frames, tolerance, finest, settings, distance) {
    const accepted = validated(given, tracks, frames, tolerance, finest, settings);
    if (!accepted.some(Boolean)) {
        return given;
    }
    const { cameras: adjusted, supported } = adjustedTo(given, tracks, tolerance, finest, settings);
    const moved = accepted.map((isAccepted, view) => isAccepted && supported[view]);
    if (!moved.some(Boolean)) {
        return given;
    }
    const apart = viewDistances(given, given, distance);
    return given.map((camera, view) => {
        if (supported[view]) {
            return moved[view] ? adjusted[view] : camera;
        }
        if (!moved[nearestOf(apart[view], supported)]) {
            return camera;
        }
        const nearest = nearestOf(apart[view], moved);
        return carriedAlong(camera, given[nearest], adjusted[nearest]);
    });
}

/**
 * The camera, keeping its given pose relative to another camera that has been refined.
 *
 * @param {Camera} camera
 * @param {Camera} given the other one before
 * @param {Camera} refined and after
 * @returns {Camera}
 */
export function carriedAlong(camera, given, refined) {
    const { rotation, translation } = relativePose(given, camera);
    const m = refined.world_to_camera;
    const pose = rotation.flatMap((row, i) =>
        [0, 1, 2, 3].map((column) => {
            const turned = row.reduce((sum, value, k) => sum + value * m[4 * k + column], 0);
            return turned + (column === 3 ? translation[i] : 0);
        }),
    );
    return { ...camera, world_to_camera: [...pose, 0, 0, 0, 1] };
}

function nearestOf(distances, among) {
    const reachable = distances.map((distance, view) => (among[view] ? distance : Infinity));
    return reachable.indexOf(Math.min(...reachable));
}
