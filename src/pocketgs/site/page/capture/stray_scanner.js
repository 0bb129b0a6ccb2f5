/**
 * Reader of Stray Scanner recordings: a video with a pose per frame; see `capture/formats/stray_scanner.py`.
 *
 * @module
 */

import { cameraAt, invertedQuaternion } from "./camera.js";
import { readTable } from "./csv_table.js";
import { depthOf } from "./depth_map.js";
import { listingOf, sourceOf } from "./listing.js";
import { sharpestInWindows, sharpness, thinningWarning } from "./sharpness.js";
import { Video } from "./video.js";

/** @typedef {import("../archive/tree.js").FileTree} FileTree */

const [VIDEO, ODOMETRY, CAMERA_MATRIX] = ["rgb.mp4", "odometry.csv", "camera_matrix.csv"];
const POSE_COLUMNS = ["frame", "x", "y", "z", "qx", "qy", "qz", "qw"];
const INTRINSIC_COLUMNS = ["fx", "fy", "cx", "cy"];

/** The app writes rotations of OpenCV's camera axes. */
const SIGNS = [1, 1, 1];

/** @type {(tree: FileTree) => boolean} */
export const recognises = (tree) => [ODOMETRY, CAMERA_MATRIX].every((name) => tree.find(name));

/**
 * Choose the sharpest frames of the video and read their poses.
 *
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} the video or a table is missing or malformed, or no frame of the video has a pose
 */
export async function read(tree, bounds, onProgress) {
    const file = tree.find(VIDEO);
    if (!file) {
        throw new Error(`no ${VIDEO}: expected the video that ${ODOMETRY} belongs to`);
    }
    const shared = await readCameraMatrix(tree.find(CAMERA_MATRIX));
    const rows = await readOdometry(tree.find(ODOMETRY), bounds);
    const video = await Video.of(file);
    const posed = [...rows.keys()].filter((index) => index < video.count).sort((a, b) => a - b);
    if (!posed.length) {
        throw new Error(`${ODOMETRY}: no pose belongs to one of the ${video.count} frames of ${VIDEO}`);
    }
    const chosen = await sharpestFrames(video, posed, bounds, onProgress);
    const frames = chosen.map((index) => {
        const { where, pose, intrinsics } = rows.get(index);
        const [fx, fy, cx, cy] = intrinsics ?? shared;
        const centre = [cx, cy].map((value) => value + bounds.arkit_pixel_centre);
        const stated = { size: [video.width, video.height], focal: [fx, fy], centre };
        const number = String(index).padStart(6, "0");
        const measured = [".png", ".npy"].map((suffix) => tree.find(`depth/${number}${suffix}`)).find(Boolean);
        const depth = depthOf(measured, bounds.depth_unit, tree.find(`confidence/${number}.png`));
        const more = { name: `${VIDEO}/${number}`, frame: index, depth };
        return sourceOf(file, cameraAt(where, stated, ...pose, bounds), more);
    });
    const warnings = mismatchWarning(posed.length, rows.size, video.count);
    warnings.push(...thinningWarning(VIDEO, chosen.length, posed.length));
    return listingOf("stray-scanner", frames, { isMetric: true, warnings });
}

async function sharpestFrames(video, posed, bounds, onProgress) {
    if (posed.length <= bounds.max_frames) {
        return posed;
    }
    const values = [];
    for await (const pixels of video.frames(posed)) {
        values.push(sharpness(pixels, bounds.sharpness_side));
        onProgress(values.length, posed.length);
    }
    return sharpestInWindows(values, bounds.max_frames).map((place) => posed[place]);
}

function mismatchWarning(posed, poses, frames) {
    if (posed === poses && posed === frames) {
        return [];
    }
    return [`${VIDEO} has ${frames} frames and ${ODOMETRY} ${poses} poses, the ${posed} that match are used`];
}

/** fx, fy, cx, cy of a 3 x 3 matrix, one row a line. */
async function readCameraMatrix(file) {
    const rows = (await readTable(file)).map(({ numbers }) => numbers);
    if (rows.length !== 3 || !rows.every((row) => row.length === 3 && row.every(Number.isFinite))) {
        throw new Error(`${file.path}: expected an intrinsic matrix of 3x3 finite numbers`);
    }
    return [rows[0][0], rows[1][1], rows[0][2], rows[1][2]];
}

/** Poses and intrinsics by the number of the video's frame. */
async function readOdometry(file, bounds) {
    const [header, ...lines] = await readTable(file);
    const names = header?.words.map((name) => name.toLowerCase()) ?? [];
    if (!POSE_COLUMNS.every((name) => names.includes(name))) {
        const expected = POSE_COLUMNS.join(", ");
        throw new Error(`${file.path}: its first line is not a header with the columns ${expected}`);
    }
    const found = new Map();
    for (const { line, words, numbers } of lines) {
        const where = `${file.path}, line ${line}`;
        if (words.length !== names.length) {
            throw new Error(`${where}: holds ${words.length} values, expected ${names.length} as in the header`);
        }
        const several = (columns) => columns.map((name) => numbers[names.lastIndexOf(name)]);
        const [index, x, y, z, ...quaternion] = several(POSE_COLUMNS);
        if (!Number.isInteger(index) || index < 0) {
            const found = words[names.lastIndexOf("frame")].slice(0, 60);
            throw new Error(`${where}: frame ${found}, expected a whole number from 0`);
        }
        if (found.has(index)) {
            throw new Error(`${where}: a second pose of frame ${index}, expected one`);
        }
        const isStated = INTRINSIC_COLUMNS.every((name) => words[names.lastIndexOf(name)]);
        const pose = invertedQuaternion(where, quaternion, [x, y, z], SIGNS, bounds);
        found.set(index, { where, pose, intrinsics: isStated ? several(INTRINSIC_COLUMNS) : null });
    }
    return found;
}
