/**
 * Writing the container of a `.pgs`; the twin of `formats/pgs_sections.py`, which documents the layout.
 *
 * @module
 */

import { crc32 } from "../../page/formats/crc32.js";
import { HEADER, KNOWN, MAGIC, ROW, VERSION } from "../../page/formats/pgs_sections.js";

/**
 * The content of a file.
 *
 * @param {[string, Uint8Array][]} sections names and contents
 * @returns {Uint8Array}
 */
export function joinSections(sections) {
    const start = HEADER + ROW * sections.length;
    const contents = new Uint8Array(sections.reduce((sum, [, content]) => sum + content.length, start));
    const view = new DataView(contents.buffer);
    let place = start;
    sections.forEach(([name, content], i) => {
        const row = HEADER + ROW * i;
        contents.set(new TextEncoder().encode(name), row);
        view.setUint8(row + 8, KNOWN[name]);
        view.setUint32(row + 12, content.length, true);
        contents.set(content, place);
        place += content.length;
    });
    view.setUint32(0, MAGIC, true);
    view.setUint16(4, VERSION, true);
    view.setUint16(6, sections.length, true);
    view.setUint32(8, crc32(contents.subarray(HEADER)), true);
    return contents;
}
