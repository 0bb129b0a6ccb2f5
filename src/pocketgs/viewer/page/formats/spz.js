/**
 * Niantic's `.spz`, versions 1 to 4; the twin of `formats/spz.py`, which documents the layout.
 *
 * @module
 */

import { requireRoom } from "../scene/gaussian_columns.js";
import { requireSound } from "./checks.js";
import { AXIS_SIGNS, streamSizes, unpack } from "./spz_attributes.js";
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
const FLAGS = 14;
const ANTIALIASED = 1;
const HAS_EXTENSIONS = 2;

/** Bytes of an extension's kind and size. */
const EXTENSION = 8;
const AXES_EXTENSION = 0xadbe0003;

/** Signs that convert from the axes of these kinds; 0 states none. The others are mirrored, or quarter turns. */
const AXES = new Map([
    [0, AXIS_SIGNS],
    [1, [-1, 1, -1]],
    [4, AXIS_SIGNS],
    [6, [1, 1, 1]],
    [7, [-1, -1, 1]],
]);

/**
 * Read a scene.
 *
 * @param {ByteStream} source at the start of the file
 * @returns {Promise<import("../scene/gaussian_columns.js").GaussianColumns>}
 * @throws {Error} it is broken, of an unknown version, or states axes that mirror the scene
 */
export async function readSpz(source) {
    const gaussians = await readAnyVersion(source);
    requireSound(gaussians);
    return gaussians;
}

async function readAnyVersion(source) {
    const start = await source.takeUpTo(2);
    source.putBack(start);
    const isPacked = start[0] === 0x1f && start[1] === 0x8b;
    const plain = isPacked ? source.gunzipped() : source;
    const header = viewOf(await plain.take(HEADER));
    const layout = layoutOf(header, isPacked ? [1, 2, 3] : [4]);
    const gaussians = isPacked ? await takeStreams(plain, header, layout) : await takeTable(source, header, layout);
    gaussians.isAntialiased = Boolean(header.getUint8(FLAGS) & ANTIALIASED);
    return gaussians;
}

/** Read versions 1 to 3: the streams, one after the other. */
async function takeStreams(plain, header, layout) {
    const streams = [];
    for (const size of streamSizes(layout)) {
        streams.push(await plain.take(size));
    }
    // Extensions come after the streams; none of them changes how the streams are read.
    if (!(header.getUint8(FLAGS) & HAS_EXTENSIONS) && (await plain.takeUpTo(1)).length) {
        throw new Error(`the .spz holds more than the bytes for ${layout.count} Gaussians`);
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
    const [count, fractionalBits] = [header.getUint32(8, true), header.getUint8(13)];
    const layout = { version, count, degree, fractionalBits, axes: AXIS_SIGNS };
    const unpacked = streamSizes(layout).reduce((sum, size) => sum + size, 0);
    requireRoom(count, (Math.min(degree, 3) + 1) ** 2, unpacked);
    return layout;
}

/** Read version 4: a table of the streams' sizes, then each stream, compressed separately. */
async function takeTable(source, header, layout) {
    const sizes = streamSizes(layout);
    const [flags, count] = [header.getUint8(FLAGS), header.getUint8(15)];
    if (count < sizes.filter(Boolean).length || count > sizes.length) {
        throw new Error(`the .spz has ${count} streams, expected ${sizes.filter(Boolean).length}`);
    }
    const table = viewOf(await source.take(LONG_HEADER - HEADER)).getUint32(0, true);
    if (table < LONG_HEADER) {
        throw new Error(`the .spz has its table of streams at byte ${table}, expected ${LONG_HEADER} or later`);
    }
    const records = await source.take(table - LONG_HEADER);
    const axes = flags & HAS_EXTENSIONS ? axesIn(viewOf(records)) : AXIS_SIGNS;
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
    return unpack(streams, { ...layout, axes });
}

/** Signs that convert from the axes that extensions state; unknown extensions are skipped. */
function axesIn(records) {
    let axes = AXIS_SIGNS;
    for (let place = 0; place < records.byteLength; ) {
        const left = records.byteLength - place;
        if (left < EXTENSION) {
            throw new Error(`an extension of the .spz is cut short after ${left} bytes`);
        }
        const [kind, size] = [records.getUint32(place, true), records.getUint32(place + 4, true)];
        if (kind === AXES_EXTENSION) {
            axes = axesOf(records, place + EXTENSION, Math.min(size, left - EXTENSION));
        }
        place += EXTENSION + size;
    }
    return axes;
}

function axesOf(records, place, size) {
    const stated = size < 4 ? "none" : records.getUint32(place, true);
    if (!AXES.has(stated)) {
        const expected = `one of ${[...AXES.keys()].join(", ")}: save it with axes right, up, back, which is 4`;
        throw new Error(`the .spz has axes of kind ${stated}, expected ${expected}`);
    }
    return AXES.get(stated);
}
