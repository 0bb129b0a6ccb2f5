/**
 * What the host writes to the GPU for a sweep; the twin of `prior/depth/webgpu/sweep_inputs.py`.
 *
 * @module
 */

import { stepOf } from "./depth_range.js";
import { isMatched, isUsable } from "./photographs.js";
import { mappingTo } from "./source_views.js";

/** @typedef {import("../capture/photograph.js").Frame} Frame */

/** The uniform fields that are numbers of the description. */
const NUMBERS = [
    ...["width", "height", "image_width", "image_height"],
    ...["hypotheses", "lanes", "bands", "band_rows", "paths"],
];

/**
 * The numbers that the description of a sweep names, but for `bands`.
 *
 * @param {Frame[]} frames the keyframe, then its source views
 * @param {Float32Array} inverse
 * @param {{paths: number}} settings the settings' `sweep`
 * @returns {Object<string, number>}
 */
export function sweepNumbers([{ camera }, ...sources], inverse, { paths }) {
    const all = [camera, ...sources.map((source) => source.camera)];
    return {
        width: camera.width,
        height: camera.height,
        image_width: Math.max(...all.map(({ width }) => width)),
        image_height: Math.max(...all.map(({ height }) => height)),
        images: all.length,
        hypotheses: inverse.length,
        paths,
    };
}

/**
 * Fields of the struct `Sweep`.
 *
 * @param {Frame[]} sources
 * @param {Float32Array} inverse
 * @param {boolean} isBounded whether the depths end before infinity
 * @param {Object<string, number>} symbols
 * @param {{small_step: number, large_step: number}} settings the settings' `sweep`
 * @returns {Object<string, number>}
 */
export function sweepFields(sources, inverse, isBounded, symbols, settings) {
    return {
        ...Object.fromEntries(NUMBERS.map((name) => [name, symbols[name]])),
        sources: symbols.images - 1,
        small_step: settings.small_step,
        large_step: settings.large_step,
        is_bounded: Number(isBounded),
        has_masks: Number(sources.some(({ mask }) => mask)),
        step: stepOf(inverse),
    };
}

/**
 * Red, green and blue of each pixel, and whether it counts, padded to one size.
 *
 * @param {Frame[]} frames
 * @param {Object<string, number>} symbols
 * @param {{matched: number, usable: number}} bits the settings' `sweep`
 * @returns {Uint32Array} (F, h, w)
 */
export function packed(frames, { image_width: across, image_height: down }, { matched, usable }) {
    const pixels = new Uint32Array(frames.length * across * down);
    frames.forEach((frame, place) => {
        const { camera, rgba } = frame;
        for (let i = 0; i < rgba.length / 4; i++) {
            const to = (place * down + Math.floor(i / camera.width)) * across + (i % camera.width);
            const colour = rgba[4 * i] | (rgba[4 * i + 1] << 8) | (rgba[4 * i + 2] << 16);
            pixels[to] = colour | (isMatched(frame, i) ? matched : 0) | (isUsable(frame, i) ? usable : 0);
        }
    });
    return pixels;
}

/**
 * The rows of each source view's turn with its shift beside them, then its width and height.
 *
 * @param {import("../capture/camera.js").Camera} view
 * @param {import("../capture/camera.js").Camera[]} sources
 * @returns {Float32Array} (R, 4, 4)
 */
export function sourceRecords(view, sources) {
    const records = sources.flatMap((other) => {
        const { turn, shift } = mappingTo(view, other);
        return [...turn.flatMap((row, i) => [...row, shift[i]]), other.width, other.height, 0, 0];
    });
    return Float32Array.from(records);
}
