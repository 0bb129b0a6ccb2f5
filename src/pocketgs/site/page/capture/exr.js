/**
 * Reading one channel of an OpenEXR file, as phones write depth: scan lines, stored or deflated (openexr.com, "File
 * Layout").
 *
 * @module
 */

import { half } from "../../page/formats/spz_attributes.js";
import { inflated } from "../archive/inflate.js";
import { MAX_PIXELS } from "./image_header.js";

/** @typedef {import("./grey_png.js").Grid} Grid */

const MAGIC = 0x0131_2f76;
/** Tiles, deep data and several parts. */
const OTHER_LAYOUTS = 0x200 | 0x800 | 0x1000;

/** Lines that are packed together, by the number of the compression. */
const LINES = { 0: 1, 2: 1, 3: 16 };

/** Bytes and reading of a number, by the number of its type. */
const TYPES = [
    { bytes: 4, read: (view, at) => view.getUint32(at, true) },
    { bytes: 2, read: (view, at) => half(view.getUint16(at, true)) },
    { bytes: 4, read: (view, at) => view.getFloat32(at, true) },
];

/**
 * Channel Z of any layer, or else the first that is not alpha.
 *
 * @param {Uint8Array} bytes of the file
 * @param {string} path for messages
 * @returns {Promise<Grid>}
 * @throws {Error} it is damaged, or of a layout that is not read here
 */
export async function readExr(bytes, path) {
    try {
        return await channelOf(new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength));
    } catch ({ message }) {
        throw new Error(`${path}: not a readable OpenEXR file (${message}), expected deflated scan lines`);
    }
}

async function channelOf(view) {
    if (view.getUint32(0, true) !== MAGIC || view.getUint32(4, true) & OTHER_LAYOUTS) {
        throw new Error("of another kind");
    }
    const { channels, compression, width, height, first, end } = headerOf(view);
    const together = LINES[compression];
    if (!together) {
        throw new Error(`compression ${compression}`);
    }
    const chosen = channels.find(({ name }) => /(^|\.)Z$/.test(name)) ?? channels.find(({ name }) => !/(^|\.)A$/.test(name)) ?? channels[0];
    const line = channels.reduce((sum, { type }) => sum + TYPES[type].bytes * width, 0);
    const before = channels.slice(0, channels.indexOf(chosen));
    const offset = before.reduce((sum, { type }) => sum + TYPES[type].bytes * width, 0);
    const { bytes, read } = TYPES[chosen.type];
    const values = new Float32Array(width * height);
    for (let block = 0; block * together < height; block++) {
        const at = Number(view.getBigUint64(end + 8 * block, true));
        const top = view.getInt32(at, true) - first;
        const lines = Math.min(together, height - top);
        const packed = new Uint8Array(view.buffer, view.byteOffset + at + 8, view.getUint32(at + 4, true));
        const content = packed.length === lines * line ? packed : await unpacked(packed, lines * line);
        const numbers = new DataView(content.buffer, content.byteOffset, content.length);
        for (let row = 0; row < lines; row++) {
            for (let column = 0; column < width; column++) {
                values[(top + row) * width + column] = read(numbers, row * line + offset + bytes * column);
            }
        }
    }
    return { width, height, values };
}

function headerOf(view) {
    const found = {};
    let at = 8;
    const text = () => {
        let letters = "";
        for (; view.getUint8(at); at++) {
            letters += String.fromCharCode(view.getUint8(at));
        }
        at++;
        return letters;
    };
    for (let name = text(); name; name = text()) {
        text();
        found[name] = at + 4;
        at += 4 + view.getUint32(at, true);
    }
    const end = at;
    const channels = [];
    at = found.channels;
    for (let name = text(); name; name = text()) {
        channels.push({ name, type: view.getInt32(at, true) });
        at += 16;
    }
    const [left, first, right, last] = [0, 4, 8, 12].map((place) => view.getInt32(found.dataWindow + place, true));
    const [width, height] = [right - left + 1, last - first + 1];
    const isSound = Math.min(width, height) > 0 && width * height <= MAX_PIXELS;
    if (!isSound || !channels.length || !channels.every(({ type }) => TYPES[type])) {
        throw new Error(`${channels.length} channels of ${width}x${height} pixels`);
    }
    return { channels, compression: view.getUint8(found.compression), width, height, first, end };
}

/** Bytes are deflated as differences, those at even places before those at odd ones. */
async function unpacked(packed, size) {
    const bytes = await inflated([packed], size);
    if (!bytes) {
        throw new Error("damaged");
    }
    for (let i = 1; i < size; i++) {
        bytes[i] += bytes[i - 1] - 128;
    }
    const half = Math.ceil(size / 2);
    return bytes.map((_, i) => bytes[i % 2 ? half + (i >> 1) : i >> 1]);
}
