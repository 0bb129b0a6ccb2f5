/**
 * What a run takes of the device's memory; see `training/planning/memory_model.py`.
 *
 * @module
 */

import { SHAPE_COLUMNS } from "../../page/constants.js";
import { sizeWithin } from "../capture/pixels.js";
import { sweptPixels } from "../prior/depth_maps.js";
import { sizeOfPixels } from "../prior/photographs.js";
import { stereoNeed } from "../prior/stereo_need.js";
import { expectedIntersections, halved, largestSizes, totalOf } from "./buffer_sizes.js";
import { PIXEL_BYTES, Shelf } from "./shelf.js";

/**
 * @typedef {import("../capture/outline.js").Outline} Outline
 * @typedef {import("./plan.js").Device} Device
 * @typedef {import("./plan.js").Wish} Wish
 *
 * @typedef {Object} Need
 * @property {number} bytes that the page takes at most
 * @property {number} bufferBytes of the GPU's buffers, at most
 * @property {number} otherBytes of all the rest while it trains
 * @property {number} largest bytes of the largest buffer that training needs
 */

/** Bytes per pixel while a photograph is decoded: the bitmap, the canvas, what is read of it, and all as an array. */
const DECODING = 16;

/** Those of depth at that size, and of it undistorted. */
const DECODING_DEPTH = 8;

/** Bytes of a pixel that may become a point; and with it, while pixels are merged, those of its voxel. */
const [CANDIDATE, MERGED] = [60, 124];

/** Copies of the scene beside the GPU's: the first one, checkpoints with both moments, and the files to save. */
const COPIES = 6;

/**
 * What a run needs at most: while photographs are decoded, while depth is computed, or while it trains.
 *
 * @param {Outline} outline
 * @param {Wish} wish
 * @param {Device} device
 * @param {Object} settings
 * @returns {Need}
 */
export function needOf({ frames, storedPixels, hasDepth, videoBytes }, wish, device, settings) {
    const sizes = frames.map((frame) => sizeWithin(frame, wish.most));
    const pixels = sizes.map(({ width, height }) => width * height);
    const photographs = pixels.reduce((sum, count, i) => sum + count * frames[i].pixelBytes, 0);
    const room = Math.floor(device.largestBuffer / PIXEL_BYTES);
    if (Math.max(...pixels) > room) {
        return { bytes: photographs, bufferBytes: 0, otherBytes: photographs, largest: Infinity };
    }
    const buffers = trainingBuffers(sizes, pixels, room, wish, device, settings);
    const columns = SHAPE_COLUMNS + 3 * settings.recipe.coefficients;
    const otherBytes = photographs + COPIES * 4 * columns * wish.gaussians;
    const decoding = (DECODING + (hasDepth ? DECODING_DEPTH : 0)) * storedPixels + videoBytes;
    const phases = [
        { buffers: 0, others: photographs + decoding },
        ...(wish.prior === "dense" ? depthPhases(sizes, photographs, device, settings.prior) : []),
        { buffers: totalOf(buffers), others: otherBytes },
    ];
    return {
        bytes: Math.max(...phases.map(({ buffers, others }) => buffers + others)),
        bufferBytes: Math.max(...phases.map(({ buffers }) => buffers)),
        otherBytes,
        largest: Math.max(...Object.values(buffers)),
    };
}

function trainingBuffers(sizes, pixels, room, { gaussians, screen }, device, { engine, recipe }) {
    // Whole pictures of a large screen would take room from training: they may be of half the size.
    const drawn = [...sizes, halved(screen)];
    const extent = {
        gaussians,
        coefficients: recipe.coefficients,
        intersections: expectedIntersections(gaussians, drawn, device.largestBuffer, engine),
        photographs: sizes.length,
        photographPixels: new Shelf(pixels, room).pixels,
    };
    return largestSizes(device.description, extent, sizes, [screen]);
}

/** Keyframes are swept, their depth maps compared, and what agrees is merged. */
function depthPhases(sizes, photographs, { depth, largestBuffer }, { keyframes, sweep, fusion }) {
    const count = Math.min(keyframes.max_keyframes, sizes.length);
    const swept = sizes.map((size) => sizeOfPixels(size, sweptPixels(count, sweep)));
    const { sweeping, comparing, mapBytes } = stereoNeed(depth, swept, count, largestBuffer, sweep);
    const pixels = swept.reduce((most, { width, height }) => Math.max(most, width * height), 0);
    const candidates = Math.min(count * pixels, fusion.max_candidates);
    return [
        { buffers: totalOf(sweeping), others: photographs + mapBytes },
        { buffers: totalOf(comparing), others: photographs + mapBytes + CANDIDATE * candidates },
        { buffers: 0, others: photographs + MERGED * candidates },
    ];
}
