/**
 * Reader of 3D Scanner App recordings, exported with "All Data"; see `capture/formats/scanner_app.py`.
 *
 * @module
 */

import { cameraAt, inverted, UP_AND_BACK } from "./camera.js";
import { depthOf } from "./depth_map.js";
import { storedSize } from "./image_header.js";
import { Fields } from "./json_fields.js";
import { listingOf, sourceOf } from "./listing.js";
import { sharpestPhotographs, thinningWarning } from "./sharpness.js";

/** @typedef {import("../archive/tree.js").FileTree} FileTree */

const cameraFiles = (tree) => tree.pathsIn("", (name) => /^frame_.*\.json$/.test(name));

/** @type {(tree: FileTree) => Promise<boolean>} */
export async function recognises(tree) {
    const [first] = cameraFiles(tree);
    return first !== undefined && (await tree.find(first).text()).includes('"cameraPoseARFrame"');
}

/**
 * Choose the sharpest photographs and read their cameras. Poses without a photograph are not used.
 *
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} a camera file is malformed, or no pose has a photograph
 */
export async function read(tree, bounds, onProgress) {
    const cameras = cameraFiles(tree);
    const pairs = cameras.map((path) => [tree.find(path), tree.find(path.replace(/json$/, "jpg"))]);
    const present = pairs.filter(([, photograph]) => photograph);
    if (!present.length) {
        throw new Error(`${cameras[0]}: none of ${cameras.length} poses has a photograph frame_NNNNN.jpg`);
    }
    const photographs = present.map(([, photograph]) => photograph);
    const chosen = await sharpestPhotographs(photographs, bounds, onProgress);
    const frames = [];
    for (const place of chosen) {
        const [depth, confidence] = ["depth", "conf"].map((kind) => {
            return tree.find(photographs[place].path.replace(/frame_(.*)\.jpg$/i, `${kind}_$1.png`));
        });
        const camera = await readCamera(...present[place], bounds);
        frames.push(sourceOf(photographs[place], camera, { depth: depthOf(depth, bounds.depth_unit, confidence) }));
    }
    const warnings = thinningWarning("frame_NNNNN.jpg", chosen.length, present.length);
    return listingOf("3d-scanner-app", frames, { isMetric: true, warnings });
}

/** Camera to world is stated by rows in ARKit's axes, and so are the intrinsics. */
async function readCamera(file, photograph, bounds) {
    const fields = await Fields.of(file);
    const [pose, matrix] = [fields.numbers("cameraPoseARFrame", 16), fields.numbers("intrinsics", 9)];
    const rows = [0, 4, 8].map((first) => pose.slice(first, first + 4));
    const [focal, size] = [[matrix[0], matrix[4]], await sizeOf(fields, matrix, photograph)];
    const centre = [matrix[2], matrix[5]].map((value) => value + bounds.arkit_pixel_centre);
    const inverse = inverted(fields.where, rows, rows.map((row) => row[3]), UP_AND_BACK, bounds);
    return cameraAt(fields.where, { size, focal, centre }, ...inverse, bounds);
}

/** The size that the intrinsics refer to: a projection's first two scales are 2 f over width and height. */
async function sizeOf(fields, matrix, photograph) {
    if (!("projectionMatrix" in fields.values)) {
        return storedSize(photograph);
    }
    const projection = fields.numbers("projectionMatrix", 16);
    if (projection[0] <= 0 || projection[5] <= 0) {
        throw new Error(`${fields.where}: field 'projectionMatrix' is not a perspective projection`);
    }
    return [(2 * matrix[0]) / projection[0], (2 * matrix[4]) / projection[5]];
}
