/**
 * What the host writes to the GPU for the comparison of depth maps; the twin of
 * `prior/depth/webgpu/comparison_inputs.py`.
 *
 * @module
 */

import { medianOf } from "../numbers/quantiles.js";
import { length } from "../../page/scene/vectors.js";
import { relativePose } from "./source_views.js";

/** Largest float32: a shader's compiler may assume that there are no infinite numbers. */
const MOST = 3.4028234663852886e38;

/**
 * @typedef {Object} View a keyframe at the size of its sweep, and its depth map
 * @property {import("../capture/camera.js").Camera} camera
 * @property {import("./stereo.js").DepthMap} map
 */

/**
 * The numbers that the description of a comparison names.
 *
 * @param {View[]} views
 * @param {number} view
 * @returns {Object<string, number>}
 */
export function comparisonNumbers(views, view) {
    const { width, height } = views[view].camera;
    return {
        width,
        height,
        image_width: Math.max(...views.map(({ camera }) => camera.width)),
        image_height: Math.max(...views.map(({ camera }) => camera.height)),
        views: views.length,
    };
}

/** Fields of the struct `Comparison`. */
export function comparisonFields(views, view, numbers, { tolerance, confidence: least }) {
    const { fx, fy, cx, cy } = views[view].camera;
    return { ...numbers, focal: [fx, fy], principal: [cx, cy], view, tolerance, least };
}

/**
 * Each view as `agreement.wgsl` reads it: the turn and shift from the compared view, intrinsics, size, step, and the
 * depth up to which its agreement counts: a copy of the compared view agrees with it whatever its depths are.
 *
 * @param {View[]} views
 * @param {number} view
 * @param {number} parallax least angle between two views' rays to a point
 * @returns {Float32Array} (K, 5, 4)
 */
export function otherRecords(views, view, parallax) {
    const own = views[view];
    const known = own.map.depth.filter((depth) => depth > 0);
    const typical = known.length ? medianOf(known) : 0;
    const records = views.flatMap(({ camera, map }) => {
        const { rotation, translation } = relativePose(own.camera, camera);
        const told = length(translation) / parallax;
        return [
            ...rotation.flatMap((row, i) => [...row, translation[i]]),
            ...[camera.fx, camera.fy, camera.cx, camera.cy],
            ...[camera.width, camera.height, Math.max(map.step, own.map.step), told >= typical ? MOST : told],
        ];
    });
    return Float32Array.from(records);
}
