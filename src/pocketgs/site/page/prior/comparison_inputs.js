/**
 * What the host writes to the GPU for the comparison of depth maps; the twin of
 * `prior/depth/webgpu/comparison_inputs.py`.
 *
 * @module
 */

import { relativePose } from "./source_views.js";

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
 * Each view as `agreement.wgsl` reads it: the turn and shift from the compared view, intrinsics, size and step.
 *
 * @param {View[]} views
 * @param {number} view
 * @returns {Float32Array} (K, 5, 4)
 */
export function otherRecords(views, view) {
    const own = views[view];
    const records = views.flatMap(({ camera, map }) => {
        const { rotation, translation } = relativePose(own.camera, camera);
        return [
            ...rotation.flatMap((row, i) => [...row, translation[i]]),
            ...[camera.fx, camera.fy, camera.cx, camera.cy],
            ...[camera.width, camera.height, Math.max(map.step, own.map.step), 0],
        ];
    });
    return Float32Array.from(records);
}
