/**
 * Writing Niantic's `.spz`, rounded no more than the format does; the twin of `formats/spz.py` and `spz_attributes.py`,
 * which document it. It is version 3, a gzip stream: browsers cannot pack with Zstandard, which version 4 needs.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../../page/constants.js";
import {
    AXIS_SIGNS,
    COLOUR_SCALE,
    HARMONIC_SIGNS,
    MAX_OTHER,
    QUATERNION_SIGNS,
    ROTATION_STEPS,
    streamSizes,
} from "../../page/formats/spz_attributes.js";
import { roundedToEven } from "../numbers/rounding.js";

/** @typedef {import("../../page/scene/gaussian_columns.js").GaussianColumns} GaussianColumns */

const MAGIC = 0x5053_474e;
const VERSION = 3;
const HEADER_BYTES = 16;
const MAX_FIXED = 2 ** 23 - 1;

/**
 * @param {GaussianColumns} scene
 * @returns {Promise<Blob>}
 * @throws {Error} a number is not finite, or a coordinate too large for the format
 */
export async function spzOf(scene) {
    const bits = fractionalBits(scene);
    const unpacked = new Blob([headerOf(scene, bits), ...streamsOf(scene, bits)]);
    const packed = unpacked.stream().pipeThrough(new CompressionStream("gzip"));
    return new Response(packed, { headers: { "Content-Type": "application/octet-stream" } }).blob();
}

function headerOf(scene, bits) {
    const header = new DataView(new ArrayBuffer(HEADER_BYTES));
    [MAGIC, VERSION, scene.count].forEach((value, i) => header.setUint32(4 * i, value, true));
    header.setUint8(12, degreeOf(scene));
    header.setUint8(13, bits);
    return header;
}

const degreeOf = ({ coefficients }) => Math.sqrt(coefficients) - 1;

/** As many as the largest coordinate allows in 24 bits. */
function fractionalBits({ shape, sh, count }) {
    if (![shape, sh].every((values) => values.every(Number.isFinite))) {
        throw new Error("the scene holds numbers that are not finite, which .spz cannot hold");
    }
    const coordinates = shape.subarray(MEAN * count, (MEAN + 3) * count);
    const largest = coordinates.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    for (let bits = 23; bits >= 0; bits--) {
        if (roundedToEven(largest * 2 ** bits) <= MAX_FIXED) {
            return bits;
        }
    }
    throw new Error(`a coordinate exceeds ${MAX_FIXED}, the maximum of .spz`);
}

/** Positions, opacities, colours, log scales, rotations and harmonics, each of all Gaussians. */
function streamsOf(scene, bits) {
    const layout = { version: VERSION, count: scene.count, degree: degreeOf(scene) };
    const [positions, opacities, colours, scales, rotations, harmonics] = streamSizes(layout).map(
        (size) => new Uint8ClampedArray(size),
    );
    const single = Math.fround;
    packPositions(scene, bits, positions);
    fill(opacities, [scene.column(OPACITY_LOGIT)], (logit) => (0.5 + 0.5 * Math.tanh(0.5 * logit)) * 255);
    const several = (count, columnOf) => Array.from({ length: count }, (_, i) => columnOf(i));
    const dc = several(3, (channel) => scene.harmonics(0, channel));
    fill(colours, dc, (value) => single(single(value * single(COLOUR_SCALE)) + 127.5));
    fill(scales, several(3, (axis) => scene.column(LOG_SCALE + axis)), (value) => single(value + 10) * 16);
    packRotations(scene, new DataView(rotations.buffer));
    const coefficientOf = (column) => 1 + Math.floor(column / 3);
    const higher = several(3 * scene.coefficients - 3, (i) => scene.harmonics(coefficientOf(i), i % 3));
    fill(harmonics, higher, (value, column) => HARMONIC_SIGNS[coefficientOf(column)] * value * 128 + 128);
    return [positions, opacities, colours, scales, rotations, harmonics];
}

/** Bytes of columns, one Gaussian after the other; what lies beyond a byte is cut off. */
function fill(bytes, columns, encode) {
    columns.forEach((values, column) => {
        values.forEach((value, i) => (bytes[columns.length * i + column] = roundedToEven(encode(value, column))));
    });
}

/** 24 bits of each coordinate, lowest first. */
function packPositions(scene, bits, bytes) {
    const steps = 2 ** bits;
    for (let axis = 0; axis < 3; axis++) {
        scene.column(MEAN + axis).forEach((value, i) => {
            const fixed = roundedToEven(AXIS_SIGNS[axis] * value * steps);
            [0, 8, 16].forEach((shift, byte) => (bytes[9 * i + 3 * axis + byte] = (fixed >> shift) & 255));
        });
    }
}

/** 2 bits for the largest of x, y, z, w, then sign and 9-bit magnitude of the others. */
function packRotations(scene, view) {
    const parts = [1, 2, 3, 0].map((part) => [QUATERNION_SIGNS[part], scene.column(QUATERNION + part)]);
    for (let i = 0; i < scene.count; i++) {
        const quaternion = parts.map(([sign, values]) => sign * values[i]);
        const length = Math.hypot(...quaternion) || 1;
        const sizes = quaternion.map(Math.abs);
        const largest = sizes.indexOf(Math.max(...sizes));
        let word = largest;
        quaternion.forEach((value, part) => {
            if (part !== largest) {
                const other = (quaternion[largest] < 0 ? -value : value) / length;
                const steps = Math.floor((Math.abs(other) / MAX_OTHER) * ROTATION_STEPS + 0.5);
                word = word * 1024 + (other < 0 && steps > 0 ? 512 : 0) + Math.min(steps, ROTATION_STEPS);
            }
        });
        view.setUint32(4 * i, word, true);
    }
}
