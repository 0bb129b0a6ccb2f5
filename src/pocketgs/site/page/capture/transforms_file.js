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
import { overShared, readIntrinsics } from "./stated_intrinsics.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("./json_fields.js").Fields} Fields
 * @typedef {import("./listing.js").FrameSource} FrameSource
 */

/**
 * Read the frames in the listed order, null where an image or a few poses are missing; returns warnings too.
 *
 * @param {Fields} document the whole file
 * @param {FileTree} tree that its paths lie in
 * @param {Object} bounds the settings' `capture`
 * @param {boolean} mayHaveMoved if no image is at its stated path, search them in the whole capture by name
 * @returns {Promise<[(FrameSource | null)[], string[]]>}
 * @throws {Error} a field is missing or malformed, a path leaves the capture, or a camera cannot be used
 */
export async function readFrames(document, tree, bounds, mayHaveMoved = true) {
    const listed = document.objects("frames").map((own) => overShared(own, document));
    const named = listed.map((fields) => fields.text("file_path"));
    const { extensions_tried: suffixes } = bounds;
    const [files, warnings] = mayHaveMoved
        ? findImages(tree, "", named, document.where, suffixes, bounds)
        : [findStated(tree, "", named, document.where, suffixes), []];
    const mayLackPose = 2 * listed.filter(lacksPose).length < listed.length;
    const frames = [];
    for (const [i, fields] of listed.entries()) {
        const isPhotograph = files[i] && !isMaskOrDepth(files[i], fields, tree, bounds);
        const isLeftOut = mayLackPose && lacksPose(fields);
        frames.push(isPhotograph && !isLeftOut ? await readFrame(fields, files[i], tree, bounds) : null);
    }
    return [frames, warnings];
}

const lacksPose = ({ values }) => (values.transform_matrix ?? null) === null;

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
 * Warnings that count the frames without an image and those without a pose.
 *
 * @type {(frames: (FrameSource | null)[], document: Fields) => string[]}
 */
export function absentWarning(frames, document) {
    const leftOut = document.objects("frames").filter((_, i) => frames[i] === null);
    return ["image file", "pose"].flatMap((what, i) => {
        const lacking = leftOut.filter((fields) => lacksPose(fields) === Boolean(i));
        const found = `${lacking.length} of ${frames.length} listed frames have no ${what}`;
        return lacking.length ? [`${document.where}: ${found}, the first ${lacking[0].text("file_path")}`] : [];
    });
}

/** A warning if photographs are listed for training and held out too, or none. @returns {string[]} */
export function heldOutTooWarning(where, both, count) {
    const found = `${where}: ${both.length} of ${count} images for training are held out too, the first ${both[0]}`;
    return both.length ? [`${found}: they are not trained on; --hold-out 0 trains on all`] : [];
}

/**
 * A warning if depth maps are absent, or have no unit: NeRFCapture writes pictures that hold no usable depth.
 *
 * @type {(frames: (FrameSource | null)[], document: Fields) => string[]}
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
 * @type {(frames: (FrameSource | null)[], document: Fields) => string[]}
 */
export function maskWarning(frames, document) {
    const named = document.objects("frames").map((own) => own.over(document).optionalText("mask_path"));
    return withoutFile("masks", named, frames, "mask", document);
}

/** A warning if files of a kind are named, but not found, or none. */
function withoutFile(kind, named, frames, part, { where }) {
    const absent = named.filter((path, i) => path !== null && frames[i] && !frames[i][part]);
    const found = `${where}: ${absent.length} of its ${kind} have no file where it states`;
    return absent.length ? [`${found}, the first ${absent[0]}`] : [];
}

/** Whether a file of another suffix than a photograph's is its mask or depth map: these often have its stem. */
function isMaskOrDepth(file, fields, tree, bounds) {
    const [own, stated] = [file.path, fields.text("file_path")].map((path) => path.split(".").at(-1).toLowerCase());
    const others = own === stated ? [] : [fields.optionalText("mask_path"), depthPath(fields)[0]].filter(Boolean);
    return others.some((path) => findMoved(tree, path, fields.where, bounds)?.path === file.path);
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
    const isFisheye = bounds.fisheye_models.includes(model) || fields.flag("is_fisheye");
    // nerfstudio's list, or else a field each.
    const listed = (fields.values.distortion_params ?? null) && fields.numbers("distortion_params", 6);
    const valueOf = (name) => {
        return listed ? listed[["k1", "k2", "k3", "k4", "p1", "p2"].indexOf(name)] : fields.optionalNumber(name);
    };
    const k4 = isFisheye || model === "FULL_OPENCV" || valueOf("k5") || valueOf("k6") ? 0 : valueOf("k4");
    if (k4) {
        const found = `the coefficient k4 is ${k4}, a fourth radial term, which OpenCV's lens does not have`;
        throw new Error(`${fields.where}: ${found}: calibrate without it, or export undistorted photographs`);
    }
    return lensOf(isFisheye, valueOf);
}
