/**
 * Reading two-dimensional arrays of NumPy's `.npy` files (numpy.lib.format).
 *
 * @module
 */

import { MAX_PIXELS } from "./image_header.js";

/** @typedef {import("./grey_png.js").Grid} Grid */

const READERS = {
    u1: "getUint8",
    u2: "getUint16",
    u4: "getUint32",
    i2: "getInt16",
    i4: "getInt32",
    f4: "getFloat32",
    f8: "getFloat64",
};

/**
 * @param {Uint8Array} bytes of the file
 * @param {string} path for messages
 * @returns {Grid}
 * @throws {Error} it is damaged, or no table of numbers
 */
export function readNpy(bytes, path) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const isLong = bytes[6] > 1;
    const begin = isLong ? 12 : 10;
    const length = bytes.length < begin ? 0 : isLong ? view.getUint32(8, true) : view.getUint16(8, true);
    const header = String.fromCharCode(...bytes.subarray(begin, begin + Math.min(length, 1000)));
    const [, order, type] = /'descr': '([<>|])(\w\d)'/.exec(header) ?? [];
    const [, height, width] = /'shape': \((\d+), (\d+)(?:, 1)?,?\)/.exec(header)?.map(Number) ?? [];
    const read = READERS[type];
    const size = Number(type?.[1]);
    const isWhole = begin + length + size * width * height === bytes.length && width * height <= MAX_PIXELS;
    if (!read || !isWhole || !header.includes("'fortran_order': False")) {
        throw new Error(`${path}: not a whole .npy file of (H, W) numbers`);
    }
    const at = (i) => view[read](begin + length + size * i, order !== ">");
    return { width, height, values: Float32Array.from({ length: width * height }, (_, i) => at(i)) };
}
