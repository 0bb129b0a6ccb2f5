/**
 * Frames of a transforms JSON file, which nerfstudio, instant-ngp and NeRF's Blender scenes share; see
 * `capture/formats/transforms_file.py`.
 *
 * @module
 */

import { normalised } from "../archive/tree.js";
import { cameraAt, inverted, UP_AND_BACK } from "./camera.js";
import { depthOf } from "./depth_map.js";
import { lensOf } from "./lens.js";
import { sourceOf } from "./listing.js";
import { readIntrinsics } from "./stated_intrinsics.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("./json_fields.js").Fields} Fields
 * @typedef {import("./listing.js").FrameSource} FrameSource
 */

/**
 * Read the frames in the listed order, null where an image is missing.
 *
 * @param {Fields} document the whole file
 * @param {FileTree} tree that its paths lie in
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<(FrameSource | null)[]>}
 * @throws {Error} a field is missing or malformed, or a camera cannot be used
 */
export async function readFrames(document, tree, bounds) {
    const listed = document.objects("frames").map((own) => own.over(document));
    const paths = listed.map((fields) => normalised(fields.text("file_path")));
    const withSuffix = (find, path) => bounds.extensions_tried.map((suffix) => find(path + suffix)).find(Boolean);
    const found = (find) => paths.map((path) => withSuffix(find, path));
    const stated = found((path) => tree.find(path));
    // Captures get moved, and tools write paths of the machine that they ran on.
    const files = stated.some(Boolean) ? stated : found((path) => tree.findByName(path));
    const frames = [];
    for (const [i, fields] of listed.entries()) {
        frames.push(files[i] ? await readFrame(fields, files[i], tree, bounds) : null);
    }
    return frames;
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
    const named = stated.map((fields) => depthPath(fields)[0]);
    const absent = named.filter((path, i) => path !== null && frames[i] && !frames[i].depth);
    const found = `${absent.length} of its depth maps have no file, the first ${absent[0]}`;
    return absent.length ? [`${document.where}: ${found}`] : [];
}

async function readFrame(fields, file, tree, bounds) {
    const intrinsics = await readIntrinsics(fields, file, bounds);
    const camera = cameraAt(fields.where, intrinsics, ...readPose(fields, bounds), bounds);
    const mask = fields.optionalText("mask_path");
    const more = { lens: readLens(fields, bounds), depth: readDepth(fields, tree, bounds) };
    return sourceOf(file, camera, { ...more, mask: mask && statedMask(mask, fields, tree) });
}

/** Null where there is no such file: photographs alone are enough. */
function readDepth(fields, tree, { depth_unit: usual }) {
    const [path, unit] = depthPath(fields);
    const file = path === null ? undefined : tree.find(path);
    return file ? depthOf(file, unit ?? usual) : null;
}

/** The depth map and its unit, or null, from nerfstudio's fields, or else instant-ngp's. */
function depthPath(fields) {
    const [own, unit] = [fields.optionalText("depth_file_path"), fields.optionalNumber("depth_unit_scale_factor")];
    const scale = fields.optionalNumber("integer_depth_scale");
    return own === null && scale !== null ? [fields.optionalText("depth_path"), scale] : [own, unit];
}

function statedMask(path, { where }, tree) {
    const file = tree.find(path);
    if (!file) {
        throw new Error(`${where}: names the mask ${path}, which is absent`);
    }
    return file;
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
    const isFisheye = bounds.fisheye_models.includes(model) || fields.values.is_fisheye === true;
    return lensOf(isFisheye, (name) => fields.optionalNumber(name));
}
