/**
 * Frames of a transforms JSON file, which nerfstudio, instant-ngp and NeRF's Blender scenes share; see
 * `capture/transforms_file.py`.
 *
 * @module
 */

import { normalised } from "../archive/tree.js";
import { cameraAt, exactRotation } from "./camera.js";
import { readHeader } from "./image_header.js";
import { lensOf } from "./lens.js";

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
        frames.push(files[i] ? await readFrame(fields, files[i], bounds) : null);
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

async function readFrame(fields, file, bounds) {
    const intrinsics = await readIntrinsics(fields, file);
    const [rotation, translation] = readPose(fields, bounds);
    const camera = cameraAt(fields.where, intrinsics, rotation, translation, bounds);
    return { name: file.path, file, camera, lens: readLens(fields, bounds) };
}

/** From focal lengths or fields of view in numbers; pixels are square unless stated otherwise. */
async function readIntrinsics(fields, file) {
    const [width, height] = statedSize(fields) ?? (await storedSize(file));
    const fx = focalLength(fields, "fl_x", "camera_angle_x", width);
    const fy = focalLength(fields, "fl_y", "camera_angle_y", height);
    if (fx === null && fy === null) {
        throw new Error(`${fields.where}: no focal length, expected fl_x or camera_angle_x`);
    }
    const centre = [fields.optionalNumber("cx") ?? width / 2, fields.optionalNumber("cy") ?? height / 2];
    return { size: [width, height], focal: [fx ?? fy, fy ?? fx], centre };
}

function statedSize(fields) {
    for (const names of [["w", "h"], ["width", "height"]]) {
        const [width, height] = names.map((name) => fields.optionalNumber(name));
        if (width !== null && height !== null && (width || height)) {
            return [width, height];
        }
    }
    return null;
}

async function storedSize(file) {
    const { width, height } = readHeader(await file.bytes(), file.path);
    return [width, height];
}

function focalLength(fields, focalName, angleName, side) {
    const [focal, angle] = [fields.optionalNumber(focalName), fields.optionalNumber(angleName)];
    if (focal !== null || angle === null) {
        return focal;
    }
    if (!(angle > 0 && angle < Math.PI)) {
        throw new Error(`${fields.where}: field '${angleName}' is ${angle}, expected radians between 0 and pi`);
    }
    return side / (2 * Math.tan(angle / 2));
}

/** World to camera of `transform_matrix`: camera to world in OpenGL axes (x right, y up, z back). */
function readPose(fields, bounds) {
    const matrix = fields.matrix("transform_matrix", [3, 4], 4);
    if (matrix.length === 4 && [0, 0, 0, 1].some((value, i) => Math.abs(matrix[3][i] - value) > 1e-3)) {
        throw new Error(`${fields.where}: field 'transform_matrix' is not a rigid 4x4 or 3x4 matrix`);
    }
    const axes = [1, -1, -1].flatMap((sign, column) => [0, 1, 2].map((row) => sign * matrix[row][column]));
    const rotation = exactRotation(fields.where, axes, bounds);
    const centre = matrix.slice(0, 3).map((row) => row[3]);
    const turned = (first) => centre.reduce((sum, value, i) => sum + rotation[first + i] * value, 0);
    const translation = [0, 3, 6].map((first) => -turned(first));
    return [rotation, translation];
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
