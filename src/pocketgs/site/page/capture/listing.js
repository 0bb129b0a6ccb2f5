/**
 * What the readers find: files, cameras and lenses as a capture states them. No image is decoded yet.
 *
 * @module
 */

import { lensOf } from "./lens.js";

/**
 * @typedef {Object} FrameSource
 * @property {string} name the image's path in the capture
 * @property {import("../archive/tree.js").StoredFile} file
 * @property {number | null} frame its number in the video that the file is, counted from 0; null for a photograph
 * @property {import("./camera.js").Camera} camera of the image as the capture states it; the file may be smaller
 * @property {import("./lens.js").Lens} lens
 * @property {import("../archive/tree.js").StoredFile | null} mask image that is white where pixels are to be used
 * @property {boolean} isMaskFound whether the capture does not name it: if it cannot be used, the frame is used whole
 * @property {import("./depth_map.js").DepthSource | null} depth that was measured
 * @property {number} border pixels to crop at each side of the image
 *
 * @typedef {Object} Cloud
 * @property {Float64Array} positions (N, 3)
 * @property {Float32Array} colours (N, 3) RGB in [0, 1]
 *
 * @typedef {Object} Listing
 * @property {string} format
 * @property {FrameSource[]} frames
 * @property {Set<string> | null} heldOut names of the capture's own test frames
 * @property {Cloud | null} cloud
 * @property {number[]} background RGB in [0, 1]
 * @property {boolean} isMetric whether lengths are metres
 * @property {string[]} warnings
 */

/** @type {import("./lens.js").Lens} */
const PINHOLE = lensOf(false, () => 0);

/**
 * A frame, with what is usual where nothing else is stated.
 *
 * @param {import("../archive/tree.js").StoredFile} file
 * @param {import("./camera.js").Camera} camera
 * @param {Object} more what differs
 * @returns {FrameSource}
 */
export function sourceOf(file, camera, more = {}) {
    const nothing = { frame: null, lens: PINHOLE, mask: null, isMaskFound: false, depth: null, border: 0 };
    return { name: file.path, file, camera, ...nothing, ...more };
}

/**
 * A capture, with what is usual where nothing else is stated.
 *
 * @param {string} format
 * @param {FrameSource[]} frames
 * @param {Object} more what differs
 * @returns {Listing}
 */
export function listingOf(format, frames, more = {}) {
    const usual = { heldOut: null, cloud: null, background: [0, 0, 0], isMetric: false, warnings: [] };
    return { format, frames, ...usual, ...more };
}

/**
 * Which frames are held out; the twin of `capture/hold_out.py`.
 *
 * @param {Listing} listing
 * @param {{hold_out_every: number, fewest_to_hold_out: number}} run the settings' `run`: every n-th frame by name, if the
 *     capture has no split of its own, and of how many frames at least
 * @returns {Set<string>} their names
 */
export function heldOutOf({ frames, heldOut }, { hold_out_every: every, fewest_to_hold_out: fewest }) {
    if (heldOut) {
        return heldOut;
    }
    if (frames.length < Math.min(fewest, every)) {
        return new Set();
    }
    const names = frames.map(({ name }) => name).sort(byCodePoint);
    return new Set(names.filter((_, i) => i % every === 0));
}

/**
 * A cloud that a file holds, checked.
 *
 * @param {Cloud} cloud
 * @param {import("../archive/tree.js").StoredFile} file
 * @param {{max_coordinate: number}} bounds the settings' `capture`
 * @returns {Cloud | null} null where it holds no point
 * @throws {Error} a coordinate is not finite or too large
 */
export function soundCloud(cloud, { path }, { max_coordinate: most }) {
    if (!cloud.positions.every((value) => Math.abs(value) < most)) {
        throw new Error(`${path}: holds NaN or coordinates beyond ${most}`);
    }
    return cloud.positions.length ? cloud : null;
}

/** As Python sorts text: by code points, not by the halves of UTF-16. */
export function byCodePoint(a, b) {
    const [left, right] = [Array.from(a), Array.from(b)];
    const at = left.findIndex((character, i) => character !== right[i]);
    if (at < 0) {
        return left.length - right.length;
    }
    return right[at] === undefined ? 1 : left[at].codePointAt(0) - right[at].codePointAt(0);
}
