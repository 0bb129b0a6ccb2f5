/**
 * Reader of NeRF-Synthetic scenes, rendered by Blender; see `capture/formats/blender.py`.
 *
 * @module
 */

import { Fields } from "./json_fields.js";
import { listingOf } from "./listing.js";
import { absentWarning, checkSomeExist, heldOutTooWarning, maskWarning, readFrames } from "./transforms_file.js";

/** What makes a folder such a capture. */
const MARK = "transforms_train.json";

const TEST = "transforms_test.json";

/** @type {(tree: import("../archive/tree.js").FileTree) => boolean} */
export const recognises = (tree) => tree.find(MARK) !== undefined;

/**
 * @param {import("../archive/tree.js").FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} a file is malformed, or no training frame has an image
 */
export async function read(tree, bounds) {
    const [train, warnings] = await readSplit(tree.find(MARK), tree, bounds);
    const background = [1, 1, 1];
    if (!tree.find(TEST)) {
        return listingOf("blender", train, { background, warnings });
    }
    // The test images may be absent: people leave them out to save space.
    const [test, moreWarnings] = await readSplit(tree.find(TEST), tree, bounds, true);
    const heldOut = test.length ? new Set(test.map(({ name }) => name)) : null;
    const both = train.filter(({ name }) => heldOut?.has(name));
    warnings.push(...moreWarnings, ...heldOutTooWarning(TEST, both.map(({ name }) => name), train.length));
    const frames = [...train.filter((frame) => !both.includes(frame)), ...test];
    return listingOf("blender", frames, { heldOut, background, warnings });
}

async function readSplit(file, tree, bounds, mayBeAbsent = false) {
    const document = await Fields.of(file);
    // Always with the folder: training and test images have the same names.
    const [frames, warnings] = await readFrames(document, tree, bounds, false);
    mayBeAbsent || checkSomeExist(frames, document);
    warnings.push(...absentWarning(frames, document), ...maskWarning(frames, document));
    return [frames.filter(Boolean), warnings];
}
