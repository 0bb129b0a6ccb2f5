/**
 * Photographs as the prior takes them: which pixels count, and smaller copies.
 *
 * @module
 */

import { resized } from "../capture/camera.js";
import { averagedMask, averagedPlane, nearestPlane } from "../capture/pixels.js";
import { roundedToEven } from "../numbers/rounding.js";

/**
 * @typedef {import("../capture/camera.js").Camera} Camera
 * @typedef {import("../capture/photograph.js").Frame} Frame
 * @typedef {import("../numbers/resizing.js").Size} Size
 */

const HALF = 128;

/** Whether a mask leaves a pixel in. @type {(frame: Frame, pixel: number) => boolean} */
export const isMatched = ({ mask }, pixel) => (mask?.[pixel] ?? 255) > 0;

/**
 * Whether a pixel is neither masked nor transparent; the twin of `Frame.usable`.
 *
 * @param {Frame} frame
 * @param {number} pixel
 * @returns {boolean}
 */
export function isUsable(frame, pixel) {
    return isMatched(frame, pixel) && (!frame.hasAlpha || frame.rgba[4 * pixel + 3] >= HALF);
}

/** The size of an image that is reduced to at most so many pixels. @type {(size: Size, most: number) => Size} */
export function sizeOfPixels({ width, height }, most) {
    const reduction = Math.max(1, Math.sqrt((width * height) / most));
    const [across, down] = [width, height].map((side) => Math.max(1, Math.trunc(side / reduction)));
    return { width: across, height: down };
}

/** The camera of a frame that is reduced to at most so many pixels. @type {(camera: Camera, most: number) => Camera} */
export function cameraWithin(camera, most) {
    const { width, height } = sizeOfPixels(camera, most);
    return width === camera.width && height === camera.height ? camera : resized(camera, width, height);
}

/** The camera of an image of so many cells on the longer side. @type {(camera: Camera, cells: number) => Camera} */
export function inCells(camera, cells) {
    const side = Math.max(camera.width, camera.height) / cells;
    return resized(camera, ...[camera.width, camera.height].map((pixels) => Math.max(1, roundedToEven(pixels / side))));
}

/** A frame, reduced to at most so many pixels. @type {(frame: Frame, most: number) => Frame} */
export function frameWithin(frame, most) {
    const camera = cameraWithin(frame.camera, most);
    if (camera === frame.camera) {
        return frame;
    }
    const rgba = averagedPlane(frame.rgba, 4, frame.camera, camera);
    const mask = frame.mask && averagedMask(frame.mask, frame.camera, camera);
    const depth = frame.depth && nearestPlane(frame.depth, frame.camera, camera);
    return { ...frame, camera, rgba, mask, depth };
}
