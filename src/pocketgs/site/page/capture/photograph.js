/**
 * Photographs as training takes them: decoded, composited, undistorted, made smaller; see `capture/loading.py`.
 *
 * @module
 */

import { resized } from "./camera.js";
import { readHeader } from "./image_header.js";
import { distorts } from "./lens.js";
import { averaged, composite, decoded, hasAlpha, sizeWithin } from "./pixels.js";
import { resampled, undistortedView } from "./undistortion.js";

/**
 * @typedef {import("./camera.js").Camera} Camera
 * @typedef {import("./listing.js").FrameSource} FrameSource
 *
 * @typedef {Object} Frame
 * @property {string} name
 * @property {Camera} camera of the image as it is now
 * @property {Uint8ClampedArray} rgba (H, W, 4) on the background; the fourth number is the photograph's alpha
 * @property {boolean} hasAlpha
 */

/**
 * Load a photograph.
 *
 * @param {FrameSource} source
 * @param {number[]} background RGB in [0, 1], behind transparent pixels
 * @param {number} most pixels of the longer side
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {Promise<Frame>}
 * @throws {Error} it cannot be decoded, or has not its camera's shape
 */
export async function loadPhotograph({ name, file, camera: stated, lens }, background, most, bounds) {
    const bytes = await file.bytes();
    const { width, height, type, plain } = readHeader(bytes, file.path);
    const fits = (across, down) =>
        Math.abs(across / stated.width / (down / stated.height) - 1) <= bounds.aspect_tolerance;
    // Poses usually refer to pixels as stored; where they do not, the camera has the shape of the turned image only.
    const isTurned = !fits(width, height) && fits(height, width);
    let pixels = await decoded(isTurned ? bytes : plain, type, file.path);
    if (!fits(pixels.width, pixels.height)) {
        const [found, expected] = [`${pixels.width}x${pixels.height}`, `${stated.width}x${stated.height}`];
        throw new Error(`${file.path}: image of ${found} pixels, expected the shape of its camera, ${expected}`);
    }
    let camera = resized(stated, pixels.width, pixels.height);
    const isTransparent = hasAlpha(pixels);
    if (isTransparent) {
        composite(pixels, background);
    }
    if (distorts(lens)) {
        const view = undistortedView(camera, lens, bounds);
        pixels = resampled(pixels, lens, view.camera, view.left, view.top);
        camera = view.camera;
    }
    const size = sizeWithin(pixels.width, pixels.height, most);
    const { rgba } = averaged(pixels, ...size);
    return { name, camera: resized(camera, ...size), rgba, hasAlpha: isTransparent };
}
