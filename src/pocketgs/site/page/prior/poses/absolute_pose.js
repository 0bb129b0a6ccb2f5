/**
 * The absolute pose of one camera, from known points and without an initial pose; the twin of
 * `prior/poses/absolute_pose.py`.
 *
 * @module
 */

import { Generator } from "../../random/generator.js";
import { trialsFor } from "../../random/trials.js";
import { adjustPose } from "../bundle/adjustment.js";
import { indicesWhere } from "../features/observations.js";
import { reprojectionErrors } from "../features/tracks.js";
import { wellSupported } from "./support.js";
import { posesOfThree } from "./three_points.js";
import { normalised } from "../../../page/scene/vectors.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 *
 * @typedef {Object} Sightings of M points in one view, wrong ones included
 * @property {Float64Array} points (M, 3) in the world
 * @property {Float64Array} pixels (M, 2)
 */

const SAMPLE = 3;

/**
 * The camera at the pose that most sightings agree on, by RANSAC and then least squares over all that agree.
 *
 * @param {Camera} camera with its intrinsics
 * @param {Sightings} sightings
 * @param {number} tolerance maximum error of an agreeing sighting in pixels
 * @param {Object} settings the settings' `absolute_pose` and `poses`
 * @returns {Camera | null} null if too few agree
 */
export function poseFromPoints(camera, sightings, tolerance, { absolute_pose: own, poses }) {
    if (sightings.points.length / 3 < own.min_observations) {
        return null;
    }
    // No prior holds the pose: the given one is wrong.
    const free = { ...poses.bundle, ...own.bundle, huber: tolerance / 2, position_sigma: Infinity, rotation_sigma: Infinity };
    let placed = sampledPose(camera, sightings, tolerance, own);
    let agreed = agreeing(placed, sightings, tolerance);
    for (let round = 0; round < 2; round++) {
        if (!isEnough(camera, agreed, own, poses)) {
            return null;
        }
        placed = adjustPose(placed, agreed.points, agreed.pixels, free);
        agreed = agreeing(placed, sightings, tolerance);
    }
    return isEnough(camera, agreed, own, poses) ? placed : null;
}

/** The sightings within the tolerance. @type {(camera: Camera, s: Sightings, tolerance: number) => Sightings} */
export function agreeing(camera, { points, pixels }, tolerance) {
    const near = indicesWithin(camera, { points, pixels }, tolerance);
    const some = (values, size) => {
        return Float64Array.from(near.flatMap((i) => [...values.subarray(size * i, size * (i + 1))]));
    };
    return { points: some(points, 3), pixels: some(pixels, 2) };
}

function indicesWithin(camera, { points, pixels }, tolerance) {
    const each = Int32Array.from({ length: points.length / 3 }, (_, i) => i);
    const errors = reprojectionErrors([camera], points, { frame: each.map(() => 0), point: each, pixels });
    return indicesWhere(errors.length, (i) => errors[i] < tolerance);
}

/** Whether sightings are enough, and well enough spread, for a pose. */
function isEnough(camera, { pixels }, { min_observations: fewest }, settings) {
    const observations = { frame: new Int32Array(pixels.length / 2), pixels };
    return wellSupported([camera], observations, fewest, settings)[0];
}

/** The camera at the pose, of those that three sightings determine, that most agree with (RANSAC). */
function sampledPose(camera, sightings, tolerance, { confidence, trials }) {
    const count = sightings.points.length / 3;
    const random = new Generator(0);
    let [best, most] = [camera, 0];
    for (let trial = 0; trial < Math.min(trials, trialsFor(most / count, SAMPLE, confidence)); trial++) {
        const sample = Array.from({ length: SAMPLE }, () => random.integer(count));
        for (const pose of posesThrough(camera, sightings, sample)) {
            const placed = { ...camera, world_to_camera: pose };
            const near = indicesWithin(placed, sightings, tolerance).length;
            if (near > most) {
                [best, most] = [placed, near];
            }
        }
    }
    return best;
}

function posesThrough({ fx, fy, cx, cy }, { points, pixels }, sample) {
    const rays = sample.map((i) => normalised([(pixels[2 * i] - cx) / fx, (pixels[2 * i + 1] - cy) / fy, 1]));
    return posesOfThree(sample.map((i) => [...points.subarray(3 * i, 3 * i + 3)]), rays);
}
