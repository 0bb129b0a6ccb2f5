/**
 * Reader of Polycam's raw data: keyframes, with corrected poses if Polycam computed them; see
 * `capture/formats/polycam.py`.
 *
 * @module
 */

import { cameraAt, inverted, UP_AND_BACK } from "./camera.js";
import { depthOf } from "./depth_map.js";
import { Fields } from "./json_fields.js";
import { listingOf, sourceOf } from "./listing.js";

/** @typedef {import("../archive/tree.js").FileTree} FileTree */

const KEYFRAMES = "keyframes";
const CAMERA_FILE = /\.json$/;

/** @type {(tree: FileTree) => boolean} */
export const recognises = (tree) => ["corrected_", ""].some((kind) => tree.hasFolder(`${KEYFRAMES}/${kind}cameras`));

/**
 * Read the keyframes, corrected ones if there are any, else as ARKit tracked them.
 *
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} a camera is malformed, or no camera has an image
 */
export async function read(tree, bounds) {
    const camerasOf = (kind) => tree.pathsIn(`${KEYFRAMES}/${kind}cameras`, (name) => CAMERA_FILE.test(name));
    const isCorrected = tree.hasFolder(`${KEYFRAMES}/corrected_images`) && camerasOf("corrected_").length > 0;
    const kind = isCorrected ? "corrected_" : "";
    const cameras = camerasOf(kind);
    const [frames, damaged] = [[], []];
    for (const path of cameras) {
        const fileIn = (folder, suffix) => {
            return tree.find(path.replace(`${kind}cameras/`, `${folder}/`).replace(CAMERA_FILE, suffix));
        };
        const image = fileIn(`${kind}images`, ".jpg") ?? fileIn(`${kind}images`, ".jpeg");
        const fields = image && (await Fields.of(tree.find(path)).catch((error) => damaged.push(error) && null));
        if (fields) {
            const border = isCorrected ? bounds.undistortion_border : 0;
            const depth = depthOf(fileIn("depth", ".png"), bounds.depth_unit, fileIn("confidence", ".png"));
            frames.push(sourceOf(image, readCamera(fields, bounds), { border, depth }));
        }
    }
    const folder = `${KEYFRAMES}/${kind}cameras`;
    if (2 * damaged.length > cameras.length) {
        throw damaged[0];
    }
    if (!frames.length) {
        throw new Error(`${folder}: none of its ${cameras.length} cameras has an image in ${KEYFRAMES}/${kind}images`);
    }
    const warnings = isCorrected ? [] : [`${folder}: not corrected, so ARKit's poses are used, which drift`];
    const absent = cameras.length - damaged.length - frames.length;
    if (absent) {
        warnings.push(`${folder}: ${absent} of ${cameras.length} cameras have no image`);
    }
    if (damaged.length) {
        const found = `${folder}: ${damaged.length} of ${cameras.length} cameras are damaged`;
        warnings.push(`${found}, the first (${damaged[0].message}): these frames are left out; copy them again`);
    }
    return listingOf("polycam", frames, { isMetric: true, warnings });
}

/** Camera to world is stated as t_00 to t_23, by rows, in ARKit's axes. */
function readCamera(fields, bounds) {
    const several = (names) => names.map((name) => fields.number(name));
    const [size, focal, centre] = [["width", "height"], ["fx", "fy"], ["cx", "cy"]].map(several);
    const rows = [0, 1, 2].map((row) => several([0, 1, 2, 3].map((column) => `t_${row}${column}`)));
    const pose = inverted(fields.where, rows, rows.map((row) => row[3]), UP_AND_BACK, bounds);
    return cameraAt(fields.where, { size, focal, centre }, ...pose, bounds);
}
