/**
 * The `.splat` of antimatter15's viewer: 32 bytes per Gaussian; the twin of `formats/splat.py`.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../constants.js";
import { GaussianColumns, MIN_SCALE, dcOf } from "../scene/gaussian_columns.js";
import { requireSound } from "./checks.js";
import { logitOfByte } from "./opacity.js";

const RECORD = 32;

const ROWS_AT_ONCE = 1 << 13;

/**
 * Read a scene.
 *
 * @param {import("./byte_stream.js").ByteStream} source at the start of the file
 * @param {number} bytes the file's size
 * @param {import("./scene_file.js").PartListener} onPart
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} it is not a whole number of records, or holds NaN, infinity or negative scales
 */
export async function readSplat(source, bytes, onPart) {
    if (bytes === 0 || bytes % RECORD) {
        throw new Error(`not a whole .splat: ${bytes} bytes, expected a multiple of ${RECORD}`);
    }
    const count = bytes / RECORD;
    const gaussians = new GaussianColumns(count, 1);
    for (let first = 0; first < count; first += ROWS_AT_ONCE) {
        const rows = Math.min(ROWS_AT_ONCE, count - first);
        readRows(new DataView((await source.take(rows * RECORD)).buffer), first, rows, gaussians);
        onPart(gaussians, first + rows);
    }
    gaussians.normaliseQuaternions();
    requireSound(gaussians);
    return gaussians;
}

function readRows(records, first, rows, gaussians) {
    for (let axis = 0; axis < 3; axis++) {
        const [means, scales] = [gaussians.column(MEAN + axis), gaussians.column(LOG_SCALE + axis)];
        const colours = gaussians.harmonics(0, axis);
        for (let row = 0; row < rows; row++) {
            const scale = records.getFloat32(RECORD * row + 12 + 4 * axis, true);
            if (scale < 0) {
                throw new Error("not a .splat: negative scales, expected standard deviations");
            }
            means[first + row] = records.getFloat32(RECORD * row + 4 * axis, true);
            scales[first + row] = Math.log(Math.max(scale, MIN_SCALE));
            colours[first + row] = dcOf(records.getUint8(RECORD * row + 24 + axis) / 255);
        }
    }
    const opacities = gaussians.column(OPACITY_LOGIT);
    for (let row = 0; row < rows; row++) {
        opacities[first + row] = logitOfByte(records.getUint8(RECORD * row + 27));
    }
    for (let part = 0; part < 4; part++) {
        const quaternions = gaussians.column(QUATERNION + part);
        for (let row = 0; row < rows; row++) {
            quaternions[first + row] = records.getUint8(RECORD * row + 28 + part) - 128;
        }
    }
}
