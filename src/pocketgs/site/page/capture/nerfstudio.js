/**
 * Reader of nerfstudio, instant-ngp and NeRFCapture captures: one transforms.json beside its images; see
 * `capture/formats/nerfstudio.py`.
 *
 * @module
 */

import { normalised, spelling, withSlashes } from "../archive/tree.js";
import { readCloud } from "./cloud_file.js";
import { fewPosedWarning } from "./few_posed.js";
import { Fields } from "./json_fields.js";
import { listingOf } from "./listing.js";
import { findMoved } from "./named_images.js";
import { NERFCAPTURE_FIELD } from "./stated_intrinsics.js";
import {
    absentWarning,
    checkSomeExist,
    depthWarning,
    heldOutTooWarning,
    maskWarning,
    readFrames,
} from "./transforms_file.js";

/** What makes a folder such a capture. */
const MARK = "transforms.json";

const PARTS = ["train_filenames", "val_filenames", "test_filenames"];

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
    checkSomeExist(listed, document);
    warnings.push(...fewPosedOf(listed, tree, bounds));
    for (const warningOf of [absentWarning, maskWarning, depthWarning]) {
        warnings.push(...warningOf(listed, document));
    }
    const [frames, heldOut] = split(document, listed);
    warnings.push(...splitWarnings(document));
    const ply = document.optionalText("ply_file_path");
    const file = ply === null ? undefined : findMoved(tree, ply, document.where, bounds);
    if (ply !== null && !file) {
        warnings.push(`${MARK}: the point cloud ${ply} is absent`);
    }
    const cloud = file ? await readCloud(file, bounds) : null;
    // ARKit's poses are in metres.
    const isMetric = NERFCAPTURE_FIELD in document.values || document.flag("metric");
    return listingOf("nerfstudio", frames, { heldOut, cloud, isMetric, warnings });
}

/** A warning if most photographs have no pose; of recordings of phone apps, whose poses are measured, none. */
function fewPosedOf(listed, tree, bounds) {
    const frames = listed.filter(Boolean);
    const [files, masks] = [frames.map(({ file }) => file), frames.map(({ mask }) => mask)];
    return frames.some(({ depth }) => depth) ? [] : fewPosedWarning(files, masks, tree, bounds, MARK);
}

/**
 * The frames to use and the names of the held-out ones, by the file's own split if it has one: the test frames, or else
 * those for validation, even where they are listed for training too. The latter are not used beside test frames, nor are
 * those outside the split.
 */
function split(document, listed) {
    const present = listed.filter(Boolean);
    const [stated, validation, test] = PARTS.map((name) => partOf(document, listed, name));
    const heldOut = test.size ? test : validation;
    const rest = present.map(({ name }) => name).filter((name) => !heldOut.has(name) && !validation.has(name));
    const train = stated.size ? stated : new Set(rest);
    const used = present.filter(({ name }) => train.has(name) || heldOut.has(name));
    return [used, heldOut.size ? heldOut : null];
}

/** Names of the existing frames in a list of paths; none if there is no such list. */
function partOf(document, listed, name) {
    const wanted = new Set(document.optionalTexts(name)?.map(keyOf));
    const stated = statedKeys(document);
    return new Set(listed.filter((frame, i) => frame && wanted.has(stated[i])).map(({ name }) => name));
}

/** Warnings about lists of the split that name no frames, whether or not their images exist, or the same ones. */
function splitWarnings(document) {
    const stated = new Set(statedKeys(document));
    const lists = PARTS.map((name) => document.optionalTexts(name) ?? []);
    const [train, validation, test] = lists.map((paths) => paths.filter((path) => stated.has(keyOf(path))));
    const warnings = PARTS.flatMap((name, i) => {
        const unknown = lists[i].filter((path) => !stated.has(keyOf(path)));
        const found = `${unknown.length} of ${lists[i].length} paths in ${name} are no file_path of a frame`;
        return unknown.length ? [`${document.where}: ${found}: correct them, the first ${unknown[0]}`] : [];
    });
    const heldOut = new Set((test.length ? test : validation).map(keyOf));
    const both = train.filter((path) => heldOut.has(keyOf(path)));
    return [...warnings, ...heldOutTooWarning(document.where, both, train.length)];
}

function statedKeys(document) {
    return document.objects("frames").map((fields) => keyOf(fields.text("file_path")));
}

/** A path without what differs between systems: its separator, case, and the encoding of accents. */
function keyOf(path) {
    return spelling(normalised(withSlashes(path)));
}
