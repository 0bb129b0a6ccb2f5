/**
 * Niantic's `.spz`, versions 1 to 4; the twin of `formats/spz.py`, which documents the layout.
 *
 * @module
 */

import { requireRoom } from "../scene/gaussian_columns.js";
import { streamSizes, unpack } from "./spz_attributes.js";
import { unpackZstd } from "./zstd.js";

/**
 * @typedef {import("./byte_stream.js").ByteStream} ByteStream
 * @typedef {import("./spz_attributes.js").Layout} Layout
 */

const MAGIC = 0x5053474e;
const HEADER = 16;
const LONG_HEADER = 32;
const TABLE_ROW = 16;
const MAX_DEGREE = 4;
const HAS_EXTENSIONS = 2;
const AXES_EXTENSION = 0xadbe0003;
const AXES_RIGHT_UP_BACK = 4;

/**
 * Read a scene.
 *
 * @param {ByteStream} source at the start of the file
 * @returns {Promise<import("../scene/gaussian_columns.js").GaussianColumns>}
 * @throws {Error} it is broken or of an unknown version
 */
export async function readSpz(source) {
    const start = await source.takeUpTo(2);
    source.putBack(start);
    const isPacked = start[0] === 0x1f && start[1] === 0x8b;
    const plain = isPacked ? source.gunzipped() : source;
    const header = viewOf(await plain.take(HEADER));
    const layout = layoutOf(header, isPacked ? [1, 2, 3] : [4]);
    if (!isPacked) {
        return unpack(await takeTable(source, header, layout), layout);
    }
    const streams = [];
    for (const size of streamSizes(layout)) {
        streams.push(await plain.take(size));
    }
    return unpack(streams, layout);
}

function viewOf(bytes) {
    return new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
}

function layoutOf(header, versions) {
    const [magic, version] = [header.getUint32(0, true), header.getUint32(4, true)];
    if (magic !== MAGIC) {
        throw new Error("not a .spz");
    }
    if (!versions.includes(version)) {
        throw new Error(`the .spz is of version ${version}, expected ${versions.join(" or ")}`);
    }
    const degree = header.getUint8(12);
    if (degree > MAX_DEGREE) {
        throw new Error(`the .spz has spherical harmonics of degree ${degree}, expected 0 to ${MAX_DEGREE}`);
    }
    const layout = { version, count: header.getUint32(8, true), degree, fractionalBits: header.getUint8(13) };
    const unpacked = streamSizes(layout).reduce((sum, size) => sum + size, 0);
    requireRoom(layout.count, (Math.min(degree, 3) + 1) ** 2, unpacked);
    return layout;
}

/** Read the streams of version 4: a table of their sizes, then each stream, compressed separately. */
async function takeTable(source, header, layout) {
    const sizes = streamSizes(layout);
    const [flags, count] = [header.getUint8(14), header.getUint8(15)];
    if (count < sizes.filter(Boolean).length || count > sizes.length) {
        throw new Error(`the .spz has ${count} streams, expected ${sizes.filter(Boolean).length}`);
    }
    const table = viewOf(await source.take(LONG_HEADER - HEADER)).getUint32(0, true);
    const records = await source.take(Math.max(table - LONG_HEADER, 0));
    if (flags & HAS_EXTENSIONS) {
        checkExtensions(viewOf(records));
    }
    const rows = viewOf(await source.take(count * TABLE_ROW));
    const streams = sizes.map(() => new Uint8Array());
    for (let i = 0; i < count; i++) {
        const [packed, whole] = [0, 8].map((offset) => Number(rows.getBigUint64(TABLE_ROW * i + offset, true)));
        if (whole !== sizes[i]) {
            throw new Error(`stream ${i} of the .spz has ${whole} bytes, expected ${sizes[i]}`);
        }
        const bytes = await source.take(packed);
        streams[i] = whole ? unpackZstd(bytes, whole) : bytes;
    }
    return streams;
}

/** Other axes than right, up, back would rotate or mirror the scene. */
function checkExtensions(records) {
    for (let place = 0; place + 8 <= records.byteLength; place += 8 + records.getUint32(place + 4, true)) {
        if (records.getUint32(place, true) === AXES_EXTENSION && records.getUint8(place + 8) !== AXES_RIGHT_UP_BACK) {
            throw new Error("the .spz states other axes than right, up, back; save it without");
        }
    }
}
