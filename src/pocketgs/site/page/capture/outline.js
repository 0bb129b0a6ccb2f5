/**
 * The sizes of a capture's photographs from their headers, before anything is decoded; see `capture/outline.py`.
 *
 * @module
 */

import { cropped, resized } from "./camera.js";
import { damage, DamagedImageError, storedSize } from "./image_header.js";
import { distorts } from "./lens.js";
import { requireInside } from "./photograph.js";
import { undistortedView } from "./undistortion.js";

/**
 * @typedef {Object} Outline
 * @property {{width: number, height: number, pixelBytes: number}[]} frames as they would be without a longest side; those
 *     without a header are left out
 * @property {number} storedPixels of the largest photograph as it is stored
 * @property {boolean} hasDepth whether depth is read with photographs
 * @property {number} videoBytes of the video that the frames are in, or 0
 */

/**
 * @param {import("./listing.js").Listing} listing
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {Promise<Outline>}
 * @throws {Error} a photograph is missing, nothing is left of it, or all are damaged
 */
export async function outlineOf({ frames }, bounds) {
    const views = new Map();
    const videoBytes = frames[0].frame === null ? 0 : frames[0].file.size;
    let damaged = null;
    const outline = { frames: [], storedPixels: 0, hasDepth: frames.some(({ depth }) => depth), videoBytes };
    for (const source of frames) {
        const { camera: stated, lens, border, file, mask, depth } = source;
        const size = source.frame === null ? await storedSize(file).catch(damage) : [stated.width, stated.height];
        if (size instanceof DamagedImageError) {
            damaged = size;
            continue;
        }
        const [width, height] = size;
        outline.storedPixels = Math.max(outline.storedPixels, width * height);
        let camera = resized(stated, width, height);
        if (distorts(lens)) {
            // Most frames share a lens.
            const key = JSON.stringify([lens, { ...camera, world_to_camera: null }]);
            views.has(key) || views.set(key, undistortedView(camera, lens, bounds).camera);
            camera = views.get(key);
        }
        requireInside(camera, border, file);
        outline.frames.push({ ...sizeOf(cropped(camera, border)), pixelBytes: 4 + (mask ? 1 : 0) + (depth ? 4 : 0) });
    }
    if (!outline.frames.length) {
        throw damaged;
    }
    return outline;
}

const sizeOf = ({ width, height }) => ({ width, height });
