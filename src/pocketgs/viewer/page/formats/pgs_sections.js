/**
 * The container of a `.pgs`; the twin of `formats/pgs_sections.py`, which documents the layout.
 *
 * @module
 */

import { crc32 } from "./crc32.js";

export const MAGIC = 0x43534750;
export const VERSION = 1;
export const HEADER = 12;
export const ROW = 16;
const OPTIONAL = 1;

/** The sections that can be read, and their types. */
export const KNOWN = {
    scene: 1,
    position: 2,
    scale: 3,
    rotation: 3,
    opacity: 3,
    colour: 3,
    codebook: 3,
    harmonic: 3,
    weights: 1,
    view: 3,
};

/**
 * The contents of a file's known sections, by name.
 *
 * @param {Uint8Array} contents
 * @returns {Map<string, Uint8Array>}
 * @throws {Error} the file is cut short, damaged, of another version, or holds an unknown section
 */
export function splitSections(contents) {
    const view = new DataView(contents.buffer, contents.byteOffset, contents.length);
    if (contents.length < HEADER || view.getUint32(0, true) !== MAGIC) {
        throw new Error("not a .pgs");
    }
    const version = view.getUint16(4, true);
    if (version !== VERSION) {
        throw new Error(`the .pgs is of version ${version}, expected ${VERSION}`);
    }
    const count = view.getUint16(6, true);
    let start = HEADER + ROW * count;
    const rows = start <= contents.length ? Array.from({ length: count }, (_, i) => rowAt(view, HEADER + ROW * i)) : [];
    const expected = rows.reduce((sum, { size }) => sum + size, start);
    if (contents.length !== expected) {
        throw new Error(`not a whole .pgs: ${contents.length} bytes, expected ${expected}`);
    }
    if (crc32(contents.subarray(HEADER)) !== view.getUint32(8, true)) {
        throw new Error("the .pgs is damaged: its checksum differs from that of its content");
    }
    const found = new Map();
    for (const { name, kind, flags, size } of rows) {
        if (Object.hasOwn(KNOWN, name) && KNOWN[name] === kind && !found.has(name)) {
            found.set(name, contents.subarray(start, start + size));
        } else if (!(flags & OPTIONAL)) {
            throw new Error(`section "${name}" of type ${kind} is repeated or unknown to this version`);
        }
        start += size;
    }
    return found;
}

function rowAt(view, place) {
    const letters = Array.from({ length: 8 }, (_, i) => String.fromCharCode(view.getUint8(place + i)));
    return {
        name: letters.join("").replace(/\0+$/, ""),
        kind: view.getUint8(place + 8),
        flags: view.getUint8(place + 9),
        size: view.getUint32(place + 12, true),
    };
}
