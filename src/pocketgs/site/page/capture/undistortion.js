/**
 * Undistorting images to pinhole images; the twin of `capture/undistortion.py`.
 *
 * @module
 */

import { distorted, undistorted } from "./lens.js";

/**
 * @typedef {import("./camera.js").Camera} Camera
 * @typedef {import("./lens.js").Lens} Lens
 * @typedef {import("./pixels.js").Pixels} Pixels
 */

/**
 * The largest pinhole camera that shows only what a distorted image shows: each side is where the undistorted border of
 * the image reaches furthest inwards.
 *
 * @param {Camera} camera of the distorted image
 * @param {Lens} lens
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {{camera: Camera, left: number, top: number}} and where it begins in the distorted image
 * @throws {Error} nothing usable is left
 */
export function undistortedView(camera, lens, bounds) {
    const { width, height, fx, fy, cx, cy } = camera;
    const steps = Array.from({ length: bounds.border_samples }, (_, i) => i / (bounds.border_samples - 1));
    const seenAt = (column, row) => {
        const [x, y] = undistorted(lens, (column - cx) / fx, (row - cy) / fy, bounds);
        return [x * fx + cx, y * fy + cy];
    };
    const columns = steps.map((share) => 0.5 + share * (width - 1));
    const rows = steps.map((share) => 0.5 + share * (height - 1));
    const sides = [
        Math.max(...rows.map((row) => seenAt(0.5, row)[0])),
        Math.min(...rows.map((row) => seenAt(width - 0.5, row)[0])),
        Math.max(...columns.map((column) => seenAt(column, 0.5)[1])),
        Math.min(...columns.map((column) => seenAt(column, height - 0.5)[1])),
    ];
    // Rounding guards against errors in the last digit; centres are at + 0.5.
    const digits = (value) => Math.round(value * 1e6) / 1e6;
    const [left, top] = [sides[0], sides[2]].map((side) => Math.ceil(digits(side - 0.5)));
    const [right, bottom] = [sides[1], sides[3]].map((side) => Math.floor(digits(side + 0.5)));
    const size = [right - left, bottom - top];
    if (!(size[0] >= 1 && size[1] >= 1 && size[0] <= 4 * width && size[1] <= 4 * height)) {
        throw new Error(`its lens leaves no usable part of an image of ${width}x${height} pixels`);
    }
    return { camera: { ...camera, width: size[0], height: size[1], cx: cx - left, cy: cy - top }, left, top };
}

/**
 * What a pinhole camera would have shown, between pixels interpolated linearly.
 *
 * @param {Pixels} pixels the distorted image
 * @param {Lens} lens
 * @param {Camera} camera from `undistortedView`, with the principal point in its own image
 * @param {number} left where that image begins in the distorted one
 * @param {number} top
 * @returns {Pixels}
 */
export function resampled({ width, height, rgba }, lens, camera, left, top) {
    const { fx, fy, cx, cy } = camera;
    const found = new Uint8ClampedArray(4 * camera.width * camera.height);
    let at = 0;
    for (let row = 0; row < camera.height; row++) {
        for (let column = 0; column < camera.width; column++) {
            const [x, y] = distorted(lens, (column + 0.5 - cx) / fx, (row + 0.5 - cy) / fy);
            const across = clamped(x * fx + cx + left - 0.5, width - 1);
            const down = clamped(y * fy + cy + top - 0.5, height - 1);
            const [c, r] = [Math.min(Math.floor(across), width - 2), Math.min(Math.floor(down), height - 2)];
            const [a, b] = [across - Math.max(c, 0), down - Math.max(r, 0)];
            const near = 4 * (Math.max(r, 0) * width + Math.max(c, 0));
            const [right, below] = [c < 0 ? 0 : 4, r < 0 ? 0 : 4 * width];
            for (let channel = 0; channel < 4; channel++, at++) {
                const i = near + channel;
                const upper = (1 - a) * rgba[i] + a * rgba[i + right];
                const lower = (1 - a) * rgba[i + below] + a * rgba[i + below + right];
                found[at] = (1 - b) * upper + b * lower;
            }
        }
    }
    return { width: camera.width, height: camera.height, rgba: found };
}

/**
 * The same of a mask or of depth, without interpolation.
 *
 * @template {Uint8ClampedArray | Float32Array} Plane
 * @param {Plane} plane (H, W) of the distorted image
 * @param {{width: number, height: number}} size of that image
 * @param {Lens} lens
 * @param {Camera} camera as for `resampled`
 * @param {number} left
 * @param {number} top
 * @returns {Plane}
 */
export function resampledPlane(plane, { width, height }, lens, camera, left, top) {
    const { fx, fy, cx, cy } = camera;
    const found = new plane.constructor(camera.width * camera.height);
    for (let row = 0; row < camera.height; row++) {
        for (let column = 0; column < camera.width; column++) {
            const [x, y] = distorted(lens, (column + 0.5 - cx) / fx, (row + 0.5 - cy) / fy);
            const [across, down] = [clamped(x * fx + cx + left, width - 1), clamped(y * fy + cy + top, height - 1)];
            found[row * camera.width + column] = plane[Math.floor(down) * width + Math.floor(across)];
        }
    }
    return found;
}

const clamped = (value, most) => Math.min(Math.max(value, 0), most);
