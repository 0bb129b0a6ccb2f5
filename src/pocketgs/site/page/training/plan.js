/**
 * What a run takes of the device's memory, before any of it is taken, and what is reduced so that it fits.
 *
 * @module
 */

import { SHAPE_COLUMNS } from "../../page/constants.js";
import { sizeWithin } from "../capture/pixels.js";
import { expectedIntersections, halved, largestSizes, totalOf } from "./buffer_sizes.js";
import { PIXEL_BYTES, Shelf } from "./shelf.js";

/**
 * @typedef {import("../capture/outline.js").Outline} Outline
 * @typedef {import("./buffer_sizes.js").Size} Size
 *
 * @typedef {Object} Wish
 * @property {number} most pixels of the longer side
 * @property {number} gaussians
 * @property {number} bytes that the page may take
 * @property {Size} screen the largest picture that may be asked for
 *
 * @typedef {Object} Device
 * @property {import("../../gpu/description.js").Description} description of the passes
 * @property {number} largestBuffer bytes that it allows
 *
 * @typedef {Object} Plan
 * @property {number} most pixels of the longer side, as wished or fewer
 * @property {number} gaussians likewise
 * @property {number} bytes that the page takes at most
 * @property {number} bufferBytes those of the GPU's buffers among them
 * @property {number} mostBufferBytes that there is room for
 * @property {string} text for the user
 */

/** Bytes per pixel while a photograph is decoded: the bitmap, the canvas, what is read of it, and all as an array. */
const DECODING = 16;

/** Those of depth at that size, and of it undistorted. */
const DECODING_DEPTH = 8;

/** Copies of the scene beside the GPU's: the first one, checkpoints with both moments, and the files to save. */
const COPIES = 6;

/**
 * Plan a run: with the photographs as large as wished if they fit, else smaller, then with fewer Gaussians.
 *
 * @param {Outline} outline
 * @param {Wish} wish
 * @param {Device} device
 * @param {Object} settings
 * @returns {Plan}
 * @throws {Error} it does not fit at the least size, with the fewest Gaussians
 */
export function planRun(outline, wish, device, settings) {
    const longest = outline.frames.reduce((most, { width, height }) => Math.max(most, width, height), 0);
    const need = (most, gaussians) => needOf(outline, { ...wish, most, gaussians }, device, settings);
    const fits = (most, gaussians) => {
        const { bytes, largest } = need(most, gaussians);
        return bytes <= wish.bytes && largest <= device.largestBuffer;
    };
    const { least_side, least_gaussians } = settings.plan;
    const wished = Math.min(wish.most, longest);
    const [leastSide, leastGaussians] = [Math.min(least_side, wished), Math.min(least_gaussians, wish.gaussians)];
    const most = largestThat((side) => fits(side, wish.gaussians), leastSide, wished) ?? leastSide;
    const gaussians = largestThat((count) => fits(most, count), leastGaussians, wish.gaussians);
    const first = need(wished, wish.gaussians);
    if (gaussians === null) {
        const { bytes } = need(leastSide, leastGaussians);
        const isLarge = bytes > wish.bytes;
        const why = isLarge ? `more than ${megabytes(wish.bytes)} MB` : "in buffers that the GPU does not allow";
        const found = `${asked(outline, leastSide, leastGaussians)} would take ${megabytes(bytes)} MB, ${why}`;
        throw new Error(`${found}: expected fewer or smaller photographs`);
    }
    const { bytes, bufferBytes, otherBytes } = need(most, gaussians);
    return {
        most: most < wished ? most : wish.most,
        gaussians,
        bytes,
        bufferBytes,
        mostBufferBytes: wish.bytes - otherBytes,
        text: textOf(outline, wish, wished, first, { most, gaussians, bytes, bufferBytes }),
    };
}

/** What a run needs: while photographs are decoded, or while it trains. */
function needOf({ frames, storedPixels, hasDepth, videoBytes }, { most, gaussians, screen }, device, { engine, recipe }) {
    const sizes = frames.map((frame) => sizeWithin(frame, most));
    const pixels = sizes.map(({ width, height }) => width * height);
    const photographs = pixels.reduce((sum, count, i) => sum + count * frames[i].pixelBytes, 0);
    const room = Math.floor(device.largestBuffer / PIXEL_BYTES);
    if (Math.max(...pixels) > room) {
        return { bytes: photographs, bufferBytes: 0, otherBytes: photographs, largest: Infinity };
    }
    // Whole pictures of a large screen would take room from training: they may be of half the size.
    const drawn = [...sizes, halved(screen)];
    const extent = {
        gaussians,
        coefficients: recipe.coefficients,
        intersections: expectedIntersections(gaussians, drawn, device.largestBuffer, engine),
        photographs: sizes.length,
        photographPixels: new Shelf(pixels, room).pixels,
    };
    const buffers = largestSizes(device.description, extent, sizes, [screen]);
    const bufferBytes = totalOf(buffers);
    const otherBytes = photographs + COPIES * 4 * (SHAPE_COLUMNS + 3 * recipe.coefficients) * gaussians;
    const decoding = (DECODING + (hasDepth ? DECODING_DEPTH : 0)) * storedPixels;
    const bytes = Math.max(photographs + decoding + videoBytes, bufferBytes + otherBytes);
    return { bytes, bufferBytes, otherBytes, largest: Math.max(...Object.values(buffers)) };
}

/** The largest whole number for which something holds that holds for all smaller ones too, or null. */
function largestThat(holds, least, most) {
    if (holds(most)) {
        return most;
    }
    let [low, high] = [least, most];
    if (!holds(low)) {
        return null;
    }
    while (high - low > 1) {
        const middle = Math.floor((low + high) / 2);
        [low, high] = holds(middle) ? [middle, high] : [low, middle];
    }
    return low;
}

function textOf(outline, wish, wished, first, { most, gaussians, bytes, bufferBytes }) {
    const takes = `Takes about ${megabytes(bytes)} MB, ${megabytes(bufferBytes)} MB of it in buffers of the GPU.`;
    const reduced = [
        ...(most < wished ? [`photographs to ${most} pixels`] : []),
        ...(gaussians < wish.gaussians ? [`splats to ${counted(gaussians)}`] : []),
    ];
    if (!reduced.length) {
        return takes;
    }
    const isLarge = first.bytes > wish.bytes;
    const why = isLarge ? `${megabytes(first.bytes)} MB` : "a buffer larger than the GPU's";
    const reason = `${asked(outline, wished, wish.gaussians)} would take ${why}`;
    return `${takes} Reduced ${reduced.join(" and ")}, because ${reason}.`;
}

const asked = ({ frames }, side, gaussians) =>
    `${frames.length} photographs of ${side} pixels and ${counted(gaussians)} splats`;

const megabytes = (bytes) => counted(Math.ceil(bytes / 1e6));

const counted = (number) => number.toLocaleString("en");
