/**
 * Decoding grey PNG files of 8 or 16 bits (ISO 15948): browsers give 8 bits only.
 *
 * @module
 */

import { inflated } from "../archive/inflate.js";
import { readHeader } from "./image_header.js";

const FIRST_CHUNK = 8;
const [GREY, PLAIN] = [0, 0];

/**
 * @typedef {Object} Grid
 * @property {number} width
 * @property {number} height
 * @property {ArrayLike<number>} values (H, W)
 */

/**
 * @param {Uint8Array} bytes of the file
 * @param {string} path for messages
 * @returns {Promise<Grid>}
 * @throws {Error} it is damaged, or in colour
 */
export async function readGreyPng(bytes, path) {
    const { width, height, type } = readHeader(bytes, path);
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const [depth, colour, , , interlace] = bytes.subarray(24, 29);
    if (type !== "image/png" || ![8, 16].includes(depth) || colour !== GREY || interlace !== PLAIN) {
        throw new Error(`${path}: expected a grey PNG of 8 or 16 bits, not interlaced`);
    }
    const step = depth / 8;
    const line = 1 + step * width;
    const packed = chunksOf(view, bytes, "IDAT");
    const rows = await inflated(packed, line * height);
    if (!rows) {
        throw new Error(`${path}: cannot be decoded, expected a whole image`);
    }
    const plain = unfiltered(rows, line, step, path);
    if (step === 1) {
        return { width, height, values: plain };
    }
    const numbers = new DataView(plain.buffer);
    return { width, height, values: Uint16Array.from({ length: width * height }, (_, i) => numbers.getUint16(2 * i)) };
}

/** The contents of a file's chunks of one kind. */
function chunksOf(view, bytes, kind) {
    const found = [];
    for (let at = FIRST_CHUNK; at + 8 <= bytes.length; ) {
        const length = view.getUint32(at);
        if (String.fromCharCode(...bytes.subarray(at + 4, at + 8)) === kind) {
            found.push(bytes.subarray(at + 8, at + 8 + length));
        }
        at += 12 + length;
    }
    return found;
}

/** Lines without the byte that says how each was predicted from the bytes to its left and above (ISO 15948, 9.2). */
function unfiltered(rows, line, step, path) {
    const width = line - 1;
    const plain = new Uint8Array((rows.length / line) * width);
    for (let row = 0; row * line < rows.length; row++) {
        const predict = PREDICTIONS[rows[row * line]];
        if (!predict) {
            throw new Error(`${path}: cannot be decoded, expected a whole image`);
        }
        const begin = row * width;
        for (let i = 0; i < width; i++) {
            const left = i < step ? 0 : plain[begin + i - step];
            const above = row ? plain[begin + i - width] : 0;
            const corner = row && i >= step ? plain[begin + i - width - step] : 0;
            plain[begin + i] = rows[row * line + 1 + i] + predict(left, above, corner);
        }
    }
    return plain;
}

const PREDICTIONS = [
    () => 0,
    (left) => left,
    (_, above) => above,
    (left, above) => (left + above) >> 1,
    nearestOf,
];

/** Which of the three is nearest to left + above - corner (Paeth). */
function nearestOf(left, above, corner) {
    const [a, b, c] = [Math.abs(above - corner), Math.abs(left - corner), Math.abs(left + above - 2 * corner)];
    return a <= b && a <= c ? left : b <= c ? above : corner;
}
