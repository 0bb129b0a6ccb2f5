/**
 * Reading a scene of any supported format, from the network or from the user's disk.
 *
 * @module
 */

import { ByteStream } from "./byte_stream.js";
import { readPgs } from "./pgs.js";
import { readPly } from "./ply.js";
import { readSplat } from "./splat.js";
import { readSpz } from "./spz.js";

/**
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 *
 * @typedef {(gaussians: GaussianColumns, count: number) => void} PartListener called with the number of Gaussians that
 *     have arrived; not called for formats that store attribute by attribute
 */

/** Suffixes of the files that can be read. */
const SUFFIXES = [".pgs", ".ply", ".splat", ".spz"];

/**
 * Read a scene while it loads.
 *
 * @param {string} name of the file, for its suffix and for messages
 * @param {ReadableStream<Uint8Array>} stream
 * @param {number} bytes the file's size
 * @param {(share: number) => void} onProgress called with the share of the file that has arrived
 * @param {PartListener} onPart
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} the file is broken or its format is not supported
 */
export async function readScene(name, stream, bytes, onProgress = () => {}, onPart = () => {}) {
    const source = new ByteStream(stream, (received) => onProgress(bytes ? received / bytes : 0));
    try {
        const gaussians = await readAny(name, source, bytes, onPart);
        if (gaussians.count === 0) {
            throw new Error("the file holds no Gaussians");
        }
        gaussians.fileBytes = bytes ?? 0;
        return gaussians;
    } catch (error) {
        throw new Error(`${name}: ${error.message}`, { cause: error });
    }
}

/**
 * Fetch a scene.
 *
 * @param {{url: string, bytes: number, is_copy: boolean}} scene its address, its size, and whether it is a copy of the
 *     user's file, whose own size is not known then
 * @param {(share: number) => void} onProgress called with the share of the file that has arrived
 * @param {PartListener} onPart
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} the server does not send it, or it is broken
 */
export async function fetchScene({ url, bytes, is_copy: isCopy }, onProgress, onPart) {
    const response = await fetch(url);
    if (!response.ok) {
        throw new Error(`${url}: the server answers ${response.status}`);
    }
    const gaussians = await readScene(url, response.body, bytes, onProgress, onPart);
    gaussians.fileBytes = isCopy ? 0 : bytes;
    return gaussians;
}

async function readAny(name, source, bytes, onPart) {
    // First by its name: it has no header, so its first numbers may have the bytes of any other.
    if (name.toLowerCase().endsWith(".splat")) {
        return readSplat(source, bytes, onPart);
    }
    const start = await source.takeUpTo(4);
    source.putBack(start);
    const text = String.fromCharCode(...start);
    if (text.startsWith("ply")) {
        return readPly(source, bytes, onPart);
    }
    if (text === "PGSC") {
        return readPgs(source);
    }
    if (text === "NGSP" || text.startsWith("\x1f\x8b")) {
        return readSpz(source);
    }
    throw new Error(`not a scene, expected ${SUFFIXES.join(", ")}`);
}
