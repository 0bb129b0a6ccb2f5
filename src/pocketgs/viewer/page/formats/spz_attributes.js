/**
 * Decoding the numbers of a `.spz`; the twin of `formats/spz_attributes.py`, which documents their encoding.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../constants.js";
import { GaussianColumns } from "../scene/gaussian_columns.js";
import { logitOfByte } from "./opacity.js";

/**
 * @typedef {Object} Layout
 * @property {number} version 1 to 4
 * @property {number} count
 * @property {number} degree of the spherical harmonics, 0 to 4
 * @property {number} fractionalBits of the positions
 * @property {number[]} axes signs of x, y and z that convert from the file's axes to ours: two are -1, or none
 */

export const COLOUR_SCALE = 0.15 * 255;
export const MAX_OTHER = Math.SQRT1_2;
export const ROTATION_STEPS = 511;

/** The coordinates, 0 to 2, in which each harmonic is odd, in the order of the 3DGS `.ply`. */
const ODD = [[], [1], [2], [0], [0, 1], [1, 2], [], [0, 2], [], [1], [0, 1, 2], [1], [2], [0], [2], [0]];

const quaternionSigns = ([x, y, z]) => [1, y * z, x * z, x * y];
const harmonicSigns = (axes) => ODD.map((odd) => odd.reduce((sign, axis) => sign * axes[axis], 1));

/** The file's axes are right, up, back unless it states others; ours are right, down, forward. */
export const AXIS_SIGNS = [1, -1, -1];
export const QUATERNION_SIGNS = quaternionSigns(AXIS_SIGNS);
export const HARMONIC_SIGNS = harmonicSigns(AXIS_SIGNS);

/**
 * Sizes of the six streams in bytes.
 *
 * @param {Layout} layout
 * @returns {number[]}
 */
export function streamSizes({ version, count, degree }) {
    const [position, rotation] = [version === 1 ? 6 : 9, version >= 3 ? 4 : 3];
    return [position, 1, 3, 3, rotation, 3 * ((degree + 1) ** 2 - 1)].map((width) => count * width);
}

/**
 * Decode a scene from six streams of the layout's sizes; coefficients above degree 3 are dropped.
 *
 * @param {Uint8Array[]} streams
 * @param {Layout} layout
 * @returns {GaussianColumns}
 */
export function unpack([positions, opacities, colours, scales, rotations, harmonics], layout) {
    const { count, degree, axes } = layout;
    const gaussians = new GaussianColumns(count, (Math.min(degree, 3) + 1) ** 2);
    unpackPositions(positions, layout, gaussians);
    gaussians.column(OPACITY_LOGIT).set(Float32Array.from(opacities, logitOfByte));
    for (let axis = 0; axis < 3; axis++) {
        const [logScales, dc] = [gaussians.column(LOG_SCALE + axis), gaussians.harmonics(0, axis)];
        for (let i = 0; i < count; i++) {
            logScales[i] = scales[3 * i + axis] / 16 - 10;
            dc[i] = (colours[3 * i + axis] - 127.5) / COLOUR_SCALE;
        }
    }
    const unpackRotation = layout.version >= 3 ? smallestThree : firstThree;
    const signs = quaternionSigns(axes);
    for (let i = 0; i < count; i++) {
        unpackRotation(rotations, i).forEach((value, part) => {
            gaussians.shape[(QUATERNION + part) * count + i] = signs[part] * value;
        });
    }
    gaussians.normaliseQuaternions();
    unpackHarmonics(harmonics, layout, gaussians);
    return gaussians;
}

function unpackPositions(positions, { version, fractionalBits, axes }, gaussians) {
    const bytes = new DataView(positions.buffer, positions.byteOffset, positions.length);
    const fixedPoint = (place) => ((positions[place] << 8) | (positions[place + 1] << 16) | (positions[place + 2] << 24)) >> 8;
    const read = version === 1 ? (n) => half(bytes.getUint16(2 * n, true)) : (n) => fixedPoint(3 * n) * 2 ** -fractionalBits;
    for (let axis = 0; axis < 3; axis++) {
        const means = gaussians.column(MEAN + axis);
        for (let i = 0; i < gaussians.count; i++) {
            means[i] = axes[axis] * read(3 * i + axis);
        }
    }
}

/** A number from its half-precision bits. @type {(bits: number) => number} */
export function half(bits) {
    const [sign, exponent, fraction] = [bits & 0x8000 ? -1 : 1, (bits >> 10) & 31, bits & 1023];
    if (exponent === 31) {
        return fraction ? NaN : sign * Infinity;
    }
    return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
}

/** w, x, y, z of versions 1 and 2: x, y, z are stored. */
function firstThree(rotations, i) {
    const [x, y, z] = [0, 1, 2].map((part) => rotations[3 * i + part] / 127.5 - 1);
    return [Math.sqrt(Math.max(0, 1 - x * x - y * y - z * z)), x, y, z];
}

/** w, x, y, z of versions 3 and 4: all but the largest are stored. */
function smallestThree(rotations, i) {
    const [a, b, c, d] = rotations.subarray(4 * i, 4 * i + 4);
    const packed = a | (b << 8) | (c << 16) | (d << 24);
    const largest = packed >>> 30;
    const parts = [packed >>> 20, packed >>> 10, packed];
    const xyzw = [0, 0, 0, 0];
    let squares = 0;
    for (let part = 0, field = 0; part < 4; part++) {
        if (part !== largest) {
            const value = ((parts[field] & ROTATION_STEPS) * MAX_OTHER) / ROTATION_STEPS;
            xyzw[part] = parts[field] & 512 ? -value : value;
            squares += value * value;
            field++;
        }
    }
    xyzw[largest] = Math.sqrt(Math.max(0, 1 - squares));
    return [xyzw[3], xyzw[0], xyzw[1], xyzw[2]];
}

function unpackHarmonics(harmonics, { degree, axes }, gaussians) {
    const width = 3 * ((degree + 1) ** 2 - 1);
    const signs = harmonicSigns(axes);
    for (let coefficient = 1; coefficient < gaussians.coefficients; coefficient++) {
        const scale = signs[coefficient] / 128;
        for (let channel = 0; channel < 3; channel++) {
            const values = gaussians.harmonics(coefficient, channel);
            const first = 3 * (coefficient - 1) + channel;
            for (let i = 0; i < gaussians.count; i++) {
                values[i] = scale * (harmonics[width * i + first] - 128);
            }
        }
    }
}
