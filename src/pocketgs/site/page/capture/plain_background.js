/**
 * The background of photographs without alpha that show an object before one plain colour; see
 * `capture/plain_background.py`.
 *
 * @module
 */

import { medianOf } from "../numbers/quantiles.js";

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
    const edges = Uint8Array.from(frames.flatMap(edgeOf));
    if (!edges.length) {
        return null;
    }
    const colour = [0, 1, 2].map((channel) => medianOf(edges.filter((_, i) => i % 3 === channel)));
    let alike = 0;
    for (let i = 0; i < edges.length; i += 3) {
        alike += colour.every((value, channel) => Math.abs(edges[i + channel] - value) <= like);
    }
    return 3 * alike >= least * edges.length ? colour.map((value) => value / 255) : null;
}

/** Levels of red, green and blue of the outermost pixels that the mask does not exclude, one after another. */
function edgeOf({ camera: { width, height }, rgba, mask }) {
    const found = [];
    for (let row = 0; row < height; row++) {
        const step = row === 0 || row === height - 1 ? 1 : Math.max(1, width - 1);
        for (let column = 0; column < width; column += step) {
            const at = row * width + column;
            if (mask?.[at] ?? true) {
                found.push(rgba[4 * at], rgba[4 * at + 1], rgba[4 * at + 2]);
            }
        }
    }
    return found;
}
