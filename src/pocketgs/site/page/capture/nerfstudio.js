/**
 * Reader of nerfstudio, instant-ngp and NeRFCapture captures: one transforms.json beside its images; see
 * `capture/formats/nerfstudio.py`.
 *
 * @module
 */

import { normalised } from "../archive/tree.js";
import { readCloud } from "./cloud_file.js";
import { Fields } from "./json_fields.js";
import { listingOf } from "./listing.js";
import { findMoved } from "./named_images.js";
import { NERFCAPTURE_FIELD } from "./stated_intrinsics.js";
import { absentWarning, depthWarning, maskWarning, readFrames } from "./transforms_file.js";

/** What makes a folder such a capture. */
const MARK = "transforms.json";

/** @type {(tree: import("../archive/tree.js").FileTree) => boolean} */
export const recognises = (tree) => tree.find(MARK) !== undefined;

/**
 * @param {import("../archive/tree.js").FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} a field is missing or malformed, or no frame has an image
 */
export async function read(tree, bounds) {
    const document = await Fields.of(tree.find(MARK));
    const [listed, warnings] = await readFrames(document, tree, bounds);
    for (const warningOf of [absentWarning, maskWarning, depthWarning]) {
        warnings.push(...warningOf(listed, document));
    }
    if (listed.length && !listed.some(Boolean)) {
        throw new Error(`${MARK}: none of the ${listed.length} listed frames has an image file`);
    }
    const [frames, heldOut] = split(document, listed);
    const ply = document.optionalText("ply_file_path");
    const file = ply === null ? undefined : findMoved(tree, ply, document.where, bounds);
    if (ply !== null && !file) {
        warnings.push(`${MARK}: the point cloud ${ply} is absent`);
    }
    const cloud = file ? await readCloud(file, bounds) : null;
    // ARKit's poses are in metres.
    const isMetric = NERFCAPTURE_FIELD in document.values || document.values.metric === true;
    return listingOf("nerfstudio", frames, { heldOut, cloud, isMetric, warnings });
}

/** The frames to use and the names of the held-out ones, by the file's own split if it has one. */
function split(document, listed) {
    const stated = document.objects("frames").map((fields) => normalised(fields.text("file_path")));
    const present = listed.filter(Boolean);
    const part = (name) => {
        const wanted = document.optionalTexts(`${name}_filenames`)?.map(normalised);
        const frames = listed.filter((frame, i) => frame && wanted?.includes(stated[i]));
        return wanted && new Set(frames.map(({ name }) => name));
    };
    const [train, validation, test] = ["train", "val", "test"].map(part);
    const heldOut = test?.size ? test : validation;
    if (!heldOut?.size) {
        return [present, null];
    }
    const isUnused = (name) => heldOut.has(name) || validation?.has(name);
    const used = train ?? new Set(present.map(({ name }) => name).filter((name) => !isUnused(name)));
    const shared = [...used].find((name) => heldOut.has(name));
    if (shared) {
        throw new Error(`${document.where}: the image ${shared} is both for training and held out`);
    }
    return [present.filter(({ name }) => used.has(name) || heldOut.has(name)), heldOut];
}
