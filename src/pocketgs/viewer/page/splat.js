/**
 * The `.splat` of antimatter15's viewer: 32 bytes a Gaussian; the twin of `formats/splat.py`.
 *
 * @module
 */

import { logitOfByte } from "./opacity.js";
import { GaussianColumns, LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION, dcOf } from "./gaussian_columns.js";

const RECORD = 32;
const SMALLEST_SCALE = 2 ** -126;

/**
 * Read a scene.
 *
 * @param {import("./byte_stream.js").ByteStream} source at the file's begin
 * @param {number} bytes the file's size
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} it is no whole number of records
 */
export async function readSplat(source, bytes) {
    if (bytes === 0 || bytes % RECORD) {
        throw new Error(`not a whole .splat: ${bytes} bytes, expected a multiple of ${RECORD}`);
    }
    const count = bytes / RECORD;
    const records = new DataView((await source.take(bytes)).buffer);
    const gaussians = new GaussianColumns(count, 1);
    for (let axis = 0; axis < 3; axis++) {
        const [means, scales] = [gaussians.column(MEAN + axis), gaussians.column(LOG_SCALE + axis)];
        const colours = gaussians.harmonics(0, axis);
        for (let i = 0; i < count; i++) {
            means[i] = records.getFloat32(RECORD * i + 4 * axis, true);
            scales[i] = Math.log(Math.max(records.getFloat32(RECORD * i + 12 + 4 * axis, true), SMALLEST_SCALE));
            colours[i] = dcOf(records.getUint8(RECORD * i + 24 + axis) / 255);
        }
    }
    const opacities = gaussians.column(OPACITY_LOGIT);
    for (let i = 0; i < count; i++) {
        opacities[i] = logitOfByte(records.getUint8(RECORD * i + 27));
    }
    for (let part = 0; part < 4; part++) {
        const quaternions = gaussians.column(QUATERNION + part);
        for (let i = 0; i < count; i++) {
            quaternions[i] = records.getUint8(RECORD * i + 28 + part) - 128;
        }
    }
    gaussians.normaliseQuaternions();
    return gaussians;
}
