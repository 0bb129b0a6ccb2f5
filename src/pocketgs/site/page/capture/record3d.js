/**
 * Reader of Record3D recordings: .r3d archives, and exports as "EXR + JPG"; see `capture/formats/record3d.py`.
 *
 * @module
 */

import { cameraAt, invertedQuaternion, UP_AND_BACK } from "./camera.js";
import { depthOf } from "./depth_map.js";
import { Fields } from "./json_fields.js";
import { listingOf, sourceOf } from "./listing.js";
import { sharpestPhotographs, thinningWarning } from "./sharpness.js";

/** @typedef {import("../archive/tree.js").FileTree} FileTree */

/** A frame's number is also the index of its pose. */
const ARCHIVE = {
    metadata: "metadata",
    folder: "rgbd",
    depth: (number) => `rgbd/${number}.depth`,
    confidence: (number) => `rgbd/${number}.conf`,
    isCompressed: true,
};
const EXPORT = {
    metadata: "metadata.json",
    folder: "rgb",
    depth: (number) => `depth/${number}.exr`,
    confidence: (number) => `conf/${number}.png`,
    isCompressed: false,
};

/** The unit of depth. */
const METRES = 1;

/** Pixels of a side of a depth map, which metadata states. */
const MAX_SIDE = 16_384;

const holds = (tree, { metadata, folder }) => tree.find(metadata) !== undefined && tree.hasFolder(folder);

/**
 * @param {FileTree} tree
 * @returns {Promise<boolean>} other programs write a metadata.json too, but without poses and a matrix K
 */
export async function recognises(tree) {
    if (holds(tree, ARCHIVE)) {
        return true;
    }
    const text = holds(tree, EXPORT) ? await tree.find(EXPORT.metadata).text() : "";
    return text.includes('"poses"') && text.includes('"K"');
}

/**
 * Choose the sharpest frames and read their cameras.
 *
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} the metadata is malformed, no pose has an image, or all poses are equal
 */
export async function read(tree, bounds, onProgress) {
    const { metadata, folder, depth, confidence, isCompressed } = holds(tree, ARCHIVE) ? ARCHIVE : EXPORT;
    const fields = await Fields.of(tree.find(metadata));
    const poses = fields.table("poses", 7);
    if (poses.length > 1 && poses.every((pose) => pose.every((value, i) => value === poses[0][i]))) {
        const found = `all ${poses.length} poses are the same`;
        throw new Error(`${fields.where}: ${found}; recordings of the selfie camera have none`);
    }
    const fileOf = (number) => tree.find(`${folder}/${number}.jpg`);
    const present = poses.flatMap((_, number) => (fileOf(number) ? [number] : []));
    if (!present.length) {
        throw new Error(`${fields.where}: none of its ${poses.length} poses has an image ${folder}/N.jpg`);
    }
    const chosen = await sharpestPhotographs(present.map(fileOf), bounds, onProgress);
    const intrinsics = readIntrinsics(fields, poses.length);
    const size = isCompressed ? sizeOfDepth(fields) : null;
    const frames = chosen.map((place) => {
        const number = present[place];
        const measured = depthOf(tree.find(depth(number)), METRES, tree.find(confidence(number)), size);
        const frame = frameOf(fileOf(number), number, poses[number], intrinsics(number), fields, bounds);
        return { ...frame, depth: measured };
    });
    const warnings = mismatchWarning(present.length, poses.length, fileOf, fields);
    warnings.push(...thinningWarning(folder, chosen.length, present.length));
    return listingOf("record3d", frames, { isMetric: true, warnings });
}

/** Camera to world is stated in axes x right, y up, z back. */
function frameOf(file, number, pose, [fx, fy, cx, cy], fields, bounds) {
    const where = `${fields.where}, frame ${number}`;
    const size = [fields.number("w"), fields.number("h")];
    const posed = invertedQuaternion(where, pose.slice(0, 4), pose.slice(4), UP_AND_BACK, bounds);
    return sourceOf(file, cameraAt(where, { size, focal: [fx, fy], centre: [cx, cy] }, ...posed, bounds));
}

/** Columns and rows of compressed depth, or null where they are not stated. */
function sizeOfDepth(fields) {
    const size = ["dw", "dh"].map((name) => fields.optionalNumber(name));
    if (size.includes(null)) {
        return null;
    }
    if (!size.every((side) => Number.isInteger(side) && side > 0 && side <= MAX_SIDE)) {
        throw new Error(`${fields.where}: depth of ${size[0]}x${size[1]} pixels`);
    }
    return size;
}

/** Of each frame fx, fy, cx, cy in pixels of the image. */
function readIntrinsics(fields, count) {
    const stated = fields.values.perFrameIntrinsicCoeffs;
    if (!stated || stated.length === 0) {
        // By columns: fx, 0, 0, 0, fy, 0, cx, cy, 1. For the first frame.
        const matrix = fields.numbers("K", 9);
        return () => [0, 4, 6, 7].map((place) => matrix[place]);
    }
    const table = fields.table("perFrameIntrinsicCoeffs", 4);
    if (table.length !== count) {
        const found = `field 'perFrameIntrinsicCoeffs' has ${table.length} rows`;
        throw new Error(`${fields.where}: ${found}, expected ${count} as 'poses'`);
    }
    return (number) => table[number];
}

function mismatchWarning(present, poses, fileOf, { where }) {
    if (present < poses) {
        return [`${where}: ${poses - present} of ${poses} poses have no image`];
    }
    return fileOf(poses) ? [`${where}: lists ${poses} poses, the images beyond them are left out`] : [];
}
