/**
 * The background of photographs without alpha that show an object before one plain colour; see
 * `capture/plain_background.py`.
 *
 * @module
 */

import { medianOf } from "../numbers/median.js";

/**
 * The one colour that nearly all pixels at the photographs' edges have, such as the white of product photographs.
 *
 * @param {import("./photograph.js").Frame[]} frames pixels that masks exclude do not count
 * @param {{plain_background: {like: number, least_share: number}}} bounds the settings' `capture`
 * @returns {number[] | null} RGB in [0, 1]; null if there is none, or a photograph has alpha
 */
export function plainBackground(frames, { plain_background: { like, least_share: least } }) {
    if (frames.some(({ hasAlpha }) => hasAlpha)) {
        return null;
    }
    const edges = frames.flatMap(edgeOf);
    if (!edges.length) {
        return null;
    }
    const colour = [0, 1, 2].map((channel) => medianOf(edges.map((pixel) => pixel[channel])));
    const isLike = (pixel) => colour.every((value, channel) => Math.abs(pixel[channel] - value) <= like);
    const isPlain = edges.filter(isLike).length >= least * edges.length;
    return isPlain ? colour.map((value) => value / 255) : null;
}

/** Colours of the outermost pixels that the mask does not exclude. */
function edgeOf({ camera: { width, height }, rgba, mask }) {
    const found = [];
    for (let row = 0; row < height; row++) {
        const step = row === 0 || row === height - 1 ? 1 : Math.max(1, width - 1);
        for (let column = 0; column < width; column += step) {
            const at = row * width + column;
            if (mask?.[at] ?? true) {
                found.push(rgba.subarray(4 * at, 4 * at + 3));
            }
        }
    }
    return found;
}
