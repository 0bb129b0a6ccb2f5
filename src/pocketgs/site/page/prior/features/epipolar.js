/**
 * Epipolar geometry of two views, in coordinates of rays.
 *
 * @module
 */

import { product } from "../../numbers/rotations.js";
import { normalised } from "../../../page/scene/vectors.js";
import { relativePose } from "../source_views.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 *
 * @typedef {Object} Rays of M matches
 * @property {Float64Array} one (M, 2) where those of the first view meet the plane at distance 1 of its camera
 * @property {Float64Array} other (M, 2) the same of the second view
 * @property {number} focal pixels per unit of these planes
 *
 * @typedef {Object} Motion from the first camera to the second
 * @property {number[]} rotation (3, 3) row by row
 * @property {number[]} direction of the translation
 */

/**
 * @param {Camera} first
 * @param {Camera} second
 * @param {Float64Array} here (M, 2) pixels in the first view
 * @param {Float64Array} there (M, 2) pixels in the second
 * @returns {Rays}
 */
export function raysOf(first, second, here, there) {
    const focal = (first.fx * first.fy * second.fx * second.fy) ** 0.25;
    return { one: onPlane(first, here), other: onPlane(second, there), focal };
}

function onPlane({ fx, fy, cx, cy }, pixels) {
    return pixels.map((value, i) => (i % 2 ? (value - cy) / fy : (value - cx) / fx));
}

/** The motion by the cameras' poses. @type {(first: Camera, second: Camera) => Motion} */
export function givenMotion(first, second) {
    const { rotation, translation } = relativePose(first, second);
    // For a camera that only turned, any direction of the translation explains the matches.
    const direction = Math.hypot(...translation) > 1e-12 ? normalised(translation) : [0, 0, 1];
    return { rotation: rotation.flat(), direction };
}

/** The essential matrix [t]ₓ R, row by row. @type {(motion: Motion) => number[]} */
export const essentialOf = ({ rotation, direction: [x, y, z] }) => product([0, -z, y, z, 0, -x, -y, x, 0], rotation);

/**
 * Signed Sampson distances in pixels (Hartley and Zisserman, "Multiple view geometry", section 11.4.3).
 *
 * @param {ArrayLike<number>} e (3, 3) essential matrix
 * @param {Rays} rays
 * @returns {Float64Array} (M,)
 */
export function sampsonDistances(e, { one, other, focal }) {
    return Float64Array.from({ length: one.length / 2 }, (_, i) => {
        const [u, v, s, t] = [one[2 * i], one[2 * i + 1], other[2 * i], other[2 * i + 1]];
        const [a, b] = [e[0] * u + e[1] * v + e[2], e[3] * u + e[4] * v + e[5]];
        const [c, d] = [e[0] * s + e[3] * t + e[6], e[1] * s + e[4] * t + e[7]];
        const off = s * a + t * b + (e[6] * u + e[7] * v + e[8]);
        return (focal * off) / Math.max(Math.hypot(a, b, c, d), 1e-12);
    });
}
