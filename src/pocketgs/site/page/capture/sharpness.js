/**
 * Sharpness of images, and the sharpest of each part of a recording; the twin of `capture/sharpness.py`.
 *
 * @module
 */

import { averagedPlane, decodedAsStored, greyOf, sizeWithin } from "./pixels.js";

/**
 * Mean absolute difference of neighbouring pixels of the reduced image; only comparable between similar views.
 *
 * @param {import("./pixels.js").Pixels} pixels
 * @param {number} side longer side at which it is measured
 * @returns {number}
 */
export function sharpness(pixels, side) {
    const { width, height } = sizeWithin(pixels, side);
    const [across, down] = [Math.max(width, 2), Math.max(height, 2)];
    const reduced = averagedPlane(greyOf(pixels), 1, pixels, { width: across, height: down });
    let [sideways, downwards] = [0, 0];
    for (let row = 0; row < down; row++) {
        for (let at = row * across; at < (row + 1) * across - 1; at++) {
            sideways += Math.abs(reduced[at + 1] - reduced[at]);
        }
    }
    for (let at = across; at < reduced.length; at++) {
        downwards += Math.abs(reduced[at] - reduced[at - across]);
    }
    return sideways / (down * (across - 1)) + downwards / ((down - 1) * across);
}

/**
 * Index of the first largest value in each of so many equal windows; all indices if there are no more.
 *
 * @param {number[]} values
 * @param {number} count at least 1
 * @returns {number[]} ascending
 */
export function sharpestInWindows(values, count) {
    const windows = Math.min(count, values.length);
    // The first windows are one longer where the values do not divide equally.
    const [size, longer] = [Math.floor(values.length / windows), values.length % windows];
    let start = 0;
    return Array.from({ length: windows }, (_, window) => {
        const end = start + size + (window < longer ? 1 : 0);
        let best = start;
        for (let i = start + 1; i < end; i++) {
            best = values[i] > values[best] ? i : best;
        }
        start = end;
        return best;
    });
}

/**
 * Which photographs of a recording to use: all, or the sharpest of each part.
 *
 * @param {import("../archive/tree.js").StoredFile[]} files in order
 * @param {{max_frames: number, sharpness_side: number}} bounds the settings' `capture`
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<number[]>} their places, ascending
 * @throws {Error} there are more than `max_frames`, and one cannot be decoded
 */
export async function sharpestPhotographs(files, { max_frames: most, sharpness_side: side }, onProgress) {
    if (files.length <= most) {
        return files.map((_, place) => place);
    }
    const values = [];
    for (const file of files) {
        values.push(sharpness(await decodedAsStored(file), side));
        onProgress(values.length, files.length);
    }
    return sharpestInWindows(values, most);
}

/**
 * A warning that says how many frames of a recording are used.
 *
 * @param {string} where
 * @param {number} chosen
 * @param {number} available
 * @returns {string[]} none if all are
 */
export function thinningWarning(where, chosen, available) {
    const found = `${where}: ${chosen} of ${available} frames are used`;
    return chosen === available ? [] : [`${found}, the sharpest of each part of the recording`];
}
