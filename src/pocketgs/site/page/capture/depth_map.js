/**
 * Depth that a phone's sensor has measured; the twin of `capture/decoding/depth_file.py`.
 *
 * @module
 */

import { unpacked } from "../archive/lzfse.js";
import { readExr } from "./exr.js";
import { readGreyPng } from "./grey_png.js";
import { readNpy } from "./npy.js";

/**
 * @typedef {import("../archive/tree.js").StoredFile} StoredFile
 * @typedef {import("./listing.js").Listing} Listing
 *
 * @typedef {Object} DepthSource
 * @property {StoredFile} file
 * @property {number} unit length of one unit of the file in the capture's units
 * @property {StoredFile | null} confidence ARKit's, of each depth; low ones are dropped
 * @property {[number, number] | null} size columns and rows of files compressed with LZFSE, which do not state them
 */

const READERS = { png: readGreyPng, exr: readExr, npy: readNpy };

const suffixOf = ({ path }) => path.slice(path.lastIndexOf(".") + 1).toLowerCase();

/**
 * A frame's depth, or null if there is none.
 *
 * @param {StoredFile | undefined} file
 * @param {number} unit
 * @param {StoredFile | undefined} confidence
 * @param {[number, number] | null} size
 * @returns {DepthSource | null}
 */
export const depthOf = (file, unit, confidence = undefined, size = null) =>
    file ? { file, unit, confidence: confidence ?? null, size } : null;

/**
 * Leave out depth in files that cannot be read here, with a warning.
 *
 * @param {Listing} listing
 * @returns {Listing}
 */
export function withReadableDepth(listing) {
    const isUnreadable = ({ depth }) => depth && !depth.size && !(suffixOf(depth.file) in READERS);
    const first = listing.frames.find(isUnreadable);
    if (!first) {
        return listing;
    }
    const frames = listing.frames.map((frame) => (isUnreadable(frame) ? { ...frame, depth: null } : frame));
    const found = `${first.depth.file.path}: its depth maps are left out`;
    const known = Object.keys(READERS).map((suffix) => `.${suffix}`);
    return { ...listing, frames, warnings: [...listing.warnings, `${found}, this page reads ${known.join(", ")}`] };
}

/** The same without any depth. @type {(listing: Listing) => Listing} */
export const withoutDepth = (listing) => ({
    ...listing,
    frames: listing.frames.map((frame) => ({ ...frame, depth: null })),
});

/**
 * Read a depth map at its stored size.
 *
 * @param {DepthSource} source
 * @returns {Promise<{width: number, height: number, values: Float32Array}>} 0 where unknown or unreliable
 * @throws {Error} a file is damaged, or depth and confidence differ in size
 */
export async function readDepth({ file, unit, confidence, size }) {
    const read = (one, type) => (size ? readCompressed(one, size, type) : readPicture(one));
    const { width, height, values } = await read(file, Float32Array);
    const depth = Float32Array.from(values, (value) => {
        const length = Math.fround(Math.fround(value) * Math.fround(unit));
        return length > 0 && length < Infinity ? length : 0;
    });
    if (confidence) {
        const reliable = await read(confidence, Uint8Array);
        if (reliable.width !== width || reliable.height !== height) {
            const [found, expected] = [reliable, { width, height }].map((grid) => `${grid.width}x${grid.height}`);
            throw new Error(`${confidence.path}: ${found} pixels, expected the depth map's ${expected}`);
        }
        depth.forEach((_, i) => (depth[i] = reliable.values[i] > 0 ? depth[i] : 0));
    }
    return { width, height, values: depth };
}

const readPicture = async (file) => READERS[suffixOf(file)](await file.bytes(), file.path);

/** Little-endian numbers by rows, compressed with LZFSE. */
async function readCompressed(file, [width, height], type) {
    const expected = width * height * type.BYTES_PER_ELEMENT;
    const bytes = unpacked(await file.bytes(), expected);
    if (!bytes) {
        const found = `cannot be decompressed with LZFSE to ${expected} bytes`;
        throw new Error(`${file.path}: ${found} for ${width}x${height} pixels`);
    }
    return { width, height, values: new type(bytes.buffer) };
}
