/**
 * The sections of a `.pgs` that is drawn without sorting; the twin of `sort_free/pgs_file.py`, which documents them.
 *
 * @module
 */

import { requireRoom } from "../scene/gaussian_columns.js";
import { Weighting } from "../scene/weighting.js";
import { RangeDecoder } from "./range_decoder.js";

/** Bytes of the section's fields before the form's numbers. */
const HEAD = 32;
const NAME = 16;

/** Bytes per coefficient that decoding takes, with the result. */
const DECODING = 12;

/**
 * What weights are made from.
 *
 * @param {Map<string, Uint8Array>} sections with `weights`
 * @param {number} count of Gaussians
 * @returns {Weighting}
 * @throws {Error} they are broken
 */
export function readWeighting(sections, count) {
    const fields = sections.get("weights");
    if (fields.length < HEAD) {
        throw new Error('section "weights" of the .pgs is too short');
    }
    const view = new DataView(fields.buffer, fields.byteOffset, fields.length);
    const [coefficients, given] = [view.getUint8(NAME), view.getUint8(NAME + 1)];
    const [step, unit] = [view.getFloat32(20, true), view.getFloat64(24, true)];
    if (fields.length !== HEAD + 8 * given || !(step > 0 && step < Infinity)) {
        throw new Error(`section "weights" of the .pgs has ${fields.length} bytes for ${given} numbers, step ${step}`);
    }
    const form = String.fromCharCode(...fields.subarray(0, NAME)).replace(/\0+$/, "");
    const numbers = Array.from({ length: given }, (_, i) => Math.exp(view.getFloat64(HEAD + 8 * i, true)));
    requireRoom(count, 1, DECODING * coefficients * count);
    const weighting = new Weighting(form, unit, numbers, coefficients, count);
    if (coefficients) {
        readViews(sections.get("view"), step, weighting);
    }
    return weighting;
}

function readViews(section, step, weighting) {
    if (!section) {
        throw new Error('section "view" of the .pgs is missing');
    }
    const coder = new RangeDecoder(section);
    const nothing = new Uint8Array(weighting.count);
    for (let k = 0; k < weighting.coefficients; k++) {
        const column = weighting.column(k);
        coder.column(nothing).forEach((level, i) => (column[i] = level * step));
    }
}
