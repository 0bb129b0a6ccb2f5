/**
 * Values of the uniform buffer, written before every image; the twin of `view_values` in `frame_values.py`.
 *
 * @module
 */

import { FRUSTUM_MARGIN, TILE } from "../constants.js";

/**
 * Bounds on x/z and y/z: the image and a margin.
 *
 * @param {import("../scene/camera.js").Camera} camera
 * @returns {{low: [number, number], high: [number, number]}}
 */
export function slopeBounds({ width, height, fx, fy, cx, cy }) {
    const [beside, above] = [FRUSTUM_MARGIN * width, FRUSTUM_MARGIN * height];
    return {
        low: [-(cx + beside) / fx, -(cy + above) / fy],
        high: [(width - cx + beside) / fx, (height - cy + above) / fy],
    };
}

/**
 * Fields of the struct `View`.
 *
 * @param {import("../scene/camera.js").Camera} camera
 * @param {[number, number, number]} background RGB
 * @param {number} near minimum depth of what is drawn, see `nearPlane`
 * @param {Object<string, number>} symbols with gaussians, coefficients, intersections and replay_depth
 * @returns {Object<string, number | number[]>}
 */
export function viewValues(camera, background, near, symbols) {
    const { width, height, fx, fy, cx, cy, world_to_camera: m } = camera;
    const [x, y, z] = [m.slice(0, 4), m.slice(4, 8), m.slice(8, 12)];
    const centre = [0, 1, 2].map((axis) => -(x[axis] * x[3] + y[axis] * y[3] + z[axis] * z[3]));
    const { low, high } = slopeBounds(camera);
    return {
        to_camera_x: x,
        to_camera_y: y,
        to_camera_z: z,
        centre: [...centre, 1],
        background: [...background, 1],
        focal: [fx, fy],
        principal: [cx, cy],
        slopes_low: low,
        slopes_high: high,
        width,
        height,
        tiles_across: Math.ceil(width / TILE),
        tiles_down: Math.ceil(height / TILE),
        gaussians: symbols.gaussians,
        coefficients: symbols.coefficients,
        intersection_capacity: symbols.intersections,
        photograph: 0,
        replay_depth: symbols.replay_depth,
        channel_groups: 1,
        first_tile: 0,
        dropout_threshold: 0,
        dropout_seed: 0,
        near,
    };
}
