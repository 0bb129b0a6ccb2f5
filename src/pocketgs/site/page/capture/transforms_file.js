/**
 * Frames of a transforms JSON file, which nerfstudio, instant-ngp and NeRF's Blender scenes share; see
 * `capture/formats/transforms_file.py`.
 *
 * @module
 */

import { cameraAt, inverted, UP_AND_BACK } from "./camera.js";
import { depthOf } from "./depth_map.js";
import { lensOf } from "./lens.js";
import { sourceOf } from "./listing.js";
import { findImages, findMoved, findStated } from "./named_images.js";
import { readIntrinsics } from "./stated_intrinsics.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("./json_fields.js").Fields} Fields
 * @typedef {import("./listing.js").FrameSource} FrameSource
 */

/**
 * Read the frames in the listed order, null where an image is missing; returns warnings too.
 *
 * @param {Fields} document the whole file
 * @param {FileTree} tree that its paths lie in
 * @param {Object} bounds the settings' `capture`
 * @param {boolean} mayHaveMoved if no image is at its stated path, search them in the whole capture by name
 * @returns {Promise<[(FrameSource | null)[], string[]]>}
 * @throws {Error} a field is missing or malformed, a path leaves the capture, or a camera cannot be used
 */
export async function readFrames(document, tree, bounds, mayHaveMoved = true) {
    const listed = document.objects("frames").map((own) => own.over(document));
    const named = listed.map((fields) => fields.text("file_path"));
    const { extensions_tried: suffixes } = bounds;
    const [files, warnings] = mayHaveMoved
        ? findImages(tree, "", named, document.where, suffixes, bounds)
        : [findStated(tree, "", named, document.where, suffixes), []];
    const frames = [];
    for (const [i, fields] of listed.entries()) {
        frames.push(files[i] ? await readFrame(fields, files[i], tree, bounds) : null);
    }
    return [frames, warnings];
}

/**
 * Refuse a file that lists no frame, or of whose frames none has an image.
 *
 * @param {(FrameSource | null)[]} frames
 * @param {Fields} document
 * @throws {Error} it does
 */
export function checkSomeExist(frames, document) {
    if (!frames.length) {
        throw new Error(`${document.where}: lists no frame, expected at least one`);
    }
    if (!frames.some(Boolean)) {
        const first = document.objects("frames")[0].text("file_path");
        const found = `none of the ${frames.length} listed frames has an image file, the first ${first}`;
        throw new Error(`${document.where}: ${found}`);
    }
}

/**
 * A warning that counts the frames without images.
 *
 * @param {(FrameSource | null)[]} frames
 * @param {Fields} document
 * @returns {string[]} one, or none
 */
export function absentWarning(frames, document) {
    const first = frames.indexOf(null);
    if (first < 0) {
        return [];
    }
    const count = frames.filter((frame) => frame === null).length;
    const path = document.objects("frames")[first].text("file_path");
    return [`${document.where}: ${count} of ${frames.length} listed frames have no image file, the first ${path}`];
}

/**
 * A warning if depth maps are absent, or have no unit: NeRFCapture writes pictures that hold no usable depth.
 *
 * @param {(FrameSource | null)[]} frames of the document, null where an image is absent
 * @param {Fields} document
 * @returns {string[]} one, or none
 */
export function depthWarning(frames, document) {
    const stated = document.objects("frames").map((own) => own.over(document));
    const hasNoUnit = (values) => !("depth_file_path" in values || "integer_depth_scale" in values);
    if (stated.some(({ values }) => "depth_path" in values && hasNoUnit(values))) {
        const found = "its depth maps are left out, since no 'integer_depth_scale' states their unit";
        return [`${document.where}: ${found}`];
    }
    return withoutFile("depth maps", stated.map((fields) => depthPath(fields)[0]), frames, "depth", document);
}

/**
 * A warning if masks are absent: frames without a mask are used whole.
 *
 * @param {(FrameSource | null)[]} frames of the document, null where an image is absent
 * @param {Fields} document
 * @returns {string[]} one, or none
 */
export function maskWarning(frames, document) {
    const named = document.objects("frames").map((own) => own.over(document).optionalText("mask_path"));
    return withoutFile("masks", named, frames, "mask", document);
}

/** A warning if files of a kind are named, but not found, or none. */
function withoutFile(kind, named, frames, part, { where }) {
    const absent = named.filter((path, i) => path !== null && frames[i] && !frames[i][part]);
    return absent.length ? [`${where}: ${absent.length} of its ${kind} have no file, the first ${absent[0]}`] : [];
}

async function readFrame(fields, file, tree, bounds) {
    const intrinsics = await readIntrinsics(fields, file, bounds);
    const camera = cameraAt(fields.where, intrinsics, ...readPose(fields, bounds), bounds);
    const lens = readLens(fields, bounds);
    const mask = beside(file, tree, fields.optionalText("mask_path"), fields.where, bounds) ?? null;
    const [path, unit] = depthPath(fields);
    const depth = depthOf(beside(file, tree, path, fields.where, bounds), unit ?? bounds.depth_unit);
    return sourceOf(file, camera, { lens, depth, mask });
}

/** The file of a photograph's mask or depth, undefined if none is stated or it is absent. */
function beside(photograph, tree, stated, where, bounds) {
    return stated === null ? undefined : findMoved(tree, stated, where, bounds, photograph);
}

/** The depth map and its unit, or null, from nerfstudio's fields, or else instant-ngp's. */
function depthPath(fields) {
    const [own, unit] = [fields.optionalText("depth_file_path"), fields.optionalNumber("depth_unit_scale_factor")];
    const scale = fields.optionalNumber("integer_depth_scale");
    return own === null && scale !== null ? [fields.optionalText("depth_path"), scale] : [own, unit];
}

/** World to camera of `transform_matrix`: camera to world in OpenGL axes (x right, y up, z back). */
function readPose(fields, bounds) {
    const matrix = fields.matrix("transform_matrix", [3, 4], 4);
    if (matrix.length === 4 && [0, 0, 0, 1].some((value, i) => Math.abs(matrix[3][i] - value) > 1e-3)) {
        throw new Error(`${fields.where}: field 'transform_matrix' is not a rigid 4x4 or 3x4 matrix`);
    }
    return inverted(fields.where, matrix, matrix.slice(0, 3).map((row) => row[3]), UP_AND_BACK, bounds);
}

function readLens(fields, bounds) {
    const model = fields.optionalText("camera_model");
    const known = [...bounds.perspective_models, ...bounds.fisheye_models];
    if (model !== null && !known.includes(model)) {
        throw new Error(`${fields.where}: field 'camera_model' is ${model}, expected one of ${known.join(", ")}`);
    }
    const other = bounds.other_lenses.find((name) => (fields.values[name] ?? false) !== false);
    if (other !== undefined) {
        const expected = `expected a 'camera_model', one of ${known.join(", ")}`;
        throw new Error(`${fields.where}: field '${other}' states another lens, ${expected}`);
    }
    const isFisheye = bounds.fisheye_models.includes(model) || fields.values.is_fisheye === true;
    return lensOf(isFisheye, (name) => fields.optionalNumber(name));
}
