/**
 * Photographs as training takes them: decoded, composited, undistorted, made smaller; see `capture/loading.py`.
 *
 * @module
 */

import { cropped, resized } from "./camera.js";
import { readDepth } from "./depth_map.js";
import { readHeader } from "./image_header.js";
import { distorts } from "./lens.js";
import { readMask } from "./masks.js";
import { averagedMask, averagedPlane, composite, decoded, hasAlpha, planeWithoutBorder } from "./pixels.js";
import { nearestPlane, sizeWithin, withoutBorder } from "./pixels.js";
import { resampled, resampledPlane, undistortedView } from "./undistortion.js";

/**
 * @typedef {import("./camera.js").Camera} Camera
 * @typedef {import("./listing.js").FrameSource} FrameSource
 * @typedef {import("./pixels.js").Pixels} Pixels
 *
 * @typedef {Object} Frame
 * @property {string} name
 * @property {Camera} camera of the image as it is now
 * @property {Uint8ClampedArray} rgba (H, W, 4) on the background; the fourth number is the photograph's alpha
 * @property {boolean} hasAlpha
 * @property {Uint8ClampedArray | null} mask (H, W), 255 for pixels to use and 0 for others
 * @property {Float32Array | null} depth (H, W) that was measured, along the optical axis; 0 where unknown
 */

/**
 * Decode a photograph in sRGB: as it is stored, unless its camera has the shape of the turned image only.
 *
 * @param {FrameSource} source
 * @param {{aspect_tolerance: number}} bounds the settings' `capture`
 * @returns {Promise<Pixels>}
 * @throws {import("./image_header.js").DamagedImageError} it cannot be decoded
 * @throws {Error} it cannot be read
 */
export async function decodedPhotograph({ file, camera }, { aspect_tolerance: tolerance }) {
    const bytes = await file.bytes();
    const { width, height, type, coloured, turnable } = readHeader(bytes, file.path);
    // Poses usually refer to pixels as stored.
    const isTurned = !hasShapeOf(camera, width, height, tolerance) && hasShapeOf(camera, height, width, tolerance);
    return decoded(isTurned ? turnable : coloured, type, file.path);
}

/**
 * Prepare a decoded photograph, with its mask and its depth.
 *
 * @param {FrameSource} source
 * @param {Pixels} pixels changed
 * @param {number[]} background RGB in [0, 1], behind transparent pixels
 * @param {number} most pixels of the longer side
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {Promise<Frame>}
 * @throws {Error} it has not its camera's shape, or a mask that the capture names cannot be used
 */
export async function prepared(source, pixels, background, most, bounds) {
    const { name, file, lens, border } = source;
    if (!hasShapeOf(source.camera, pixels.width, pixels.height, bounds.aspect_tolerance)) {
        const [found, expected] = [pixels, source.camera].map(({ width, height }) => `${width}x${height}`);
        throw new Error(`${file.path}: image of ${found} pixels, expected the shape of its camera, ${expected}`);
    }
    let camera = resized(source.camera, pixels.width, pixels.height);
    let mask = source.mask && (await maskOfSize(source.mask, pixels, bounds).catch(unless(source.isMaskFound)));
    let depth = source.depth && (await depthOfSize(source.depth, pixels, bounds));
    const isTransparent = hasAlpha(pixels);
    if (isTransparent) {
        composite(pixels, background);
    }
    if (distorts(lens)) {
        const view = undistortedView(camera, lens, bounds);
        mask &&= resampledPlane(mask, pixels, lens, view.camera, view.left, view.top);
        depth &&= resampledPlane(depth, pixels, lens, view.camera, view.left, view.top);
        pixels = resampled(pixels, lens, view.camera, view.left, view.top);
        camera = view.camera;
    }
    if (border) {
        requireInside(camera, border, file);
        mask &&= planeWithoutBorder(mask, camera.width, camera.height, border, 1);
        depth &&= planeWithoutBorder(depth, camera.width, camera.height, border, 1);
        pixels = withoutBorder(pixels, border);
        camera = cropped(camera, border);
    }
    const size = sizeWithin(pixels, most);
    const rgba = averagedPlane(pixels.rgba, 4, pixels, size);
    mask &&= averagedMask(mask, pixels, size);
    depth &&= nearestPlane(depth, pixels, size);
    return { name, camera: resized(camera, size.width, size.height), rgba, hasAlpha: isTransparent, mask, depth };
}

function hasShapeOf({ width, height }, across, down, tolerance) {
    return Math.abs(across / width / (down / height) - 1) <= tolerance;
}

/**
 * Depth of its photograph's size; null if it cannot be read or has another shape: it may be a coloured picture, of
 * another part of the view, or turned. A photograph alone is enough.
 */
async function depthOfSize(source, size, { plane_aspect_tolerance: tolerance }) {
    const found = await readDepth(source).catch(() => null);
    const fits = found !== null && hasShapeOf(found, size.width, size.height, tolerance);
    return fits ? nearestPlane(found.values, found, size) : null;
}

/** What happens if a mask cannot be used: one that was found is left out. */
const unless = (isFound) => (error) => {
    if (!isFound) {
        throw error;
    }
    return null;
};

/** A mask of its photograph's size: of each pixel what lies at its centre. */
async function maskOfSize(file, { width, height }, { plane_aspect_tolerance: tolerance }) {
    const mask = await readMask(file);
    if (!hasShapeOf(mask, width, height, tolerance)) {
        const found = `${file.path}: mask of ${mask.width}x${mask.height} pixels`;
        throw new Error(`${found}, expected the shape of its photograph, ${width}x${height}`);
    }
    return nearestPlane(mask.used, mask, { width, height });
}

/**
 * Refuse an image that a border leaves nothing of.
 *
 * @param {{width: number, height: number}} size
 * @param {number} border
 * @param {import("../archive/tree.js").StoredFile} file
 */
export function requireInside({ width, height }, border, file) {
    if (Math.min(width, height) <= 2 * border) {
        throw new Error(`${file.path}: image of ${width}x${height} pixels, expected more than its border of ${border}`);
    }
}
