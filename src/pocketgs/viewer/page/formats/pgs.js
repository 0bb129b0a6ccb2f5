/**
 * PocketGS' own `.pgs`; the twin of `formats/pgs.py`, which documents the layout.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../constants.js";
import { GaussianColumns, requireRoom } from "../scene/gaussian_columns.js";
import { requireSound } from "./checks.js";
import { coarsenessOf, codeColours, codeHarmonic, codeScales, codeTurns, nearestBefore } from "./pgs_attributes.js";
import { decodePositions } from "./pgs_positions.js";
import { finenessOf, quaternionOf, stepOf } from "./pgs_rotations.js";
import { splitSections } from "./pgs_sections.js";
import { readWeighting } from "./pgs_weights.js";
import { MAX_NUMBER, RangeDecoder } from "./range_decoder.js";

/** Bytes of the section of fields. */
const SCENE = 44;
const MAX_BITS = 24;
const MAX_ENTRIES = 1 << 14;

/** Bytes per Gaussian that decoding takes, in addition to the scene. */
const DECODING = 150;

/**
 * Read a scene.
 *
 * @param {import("./byte_stream.js").ByteStream} source at the start of the file
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} it is broken or of an unknown version
 */
export async function readPgs(source) {
    const sections = splitSections(await source.takeUpTo(Infinity));
    const layout = layoutOf(sections);
    const { count, coefficients } = layout;
    const codeOf = (name) => readingOf(sections.get(name));
    const table = [0, 1, 2].map(() => new Int32Array(count));
    const gaussians = new GaussianColumns(count, coefficients);
    const cells = decodePositions(sections.get("position"), count, layout.bits);
    cells.forEach((column, axis) => {
        scaled(gaussians.column(MEAN + axis), column, 2 ** layout.exponent, layout.origin[axis]);
    });
    const scales = codeScales(codeOf("scale"), table, coarsenessOf(cells));
    scales.forEach((column, axis) => scaled(gaussians.column(LOG_SCALE + axis), column, layout.steps.logScale));
    readRotations(codeOf("rotation"), table, scales, layout, gaussians);
    const opacities = codeOf("opacity")(table[0], new Uint8Array(count));
    scaled(gaussians.column(OPACITY_LOGIT), opacities, layout.steps.opacity);
    codeColours(codeOf("colour"), table, nearestBefore(cells)).forEach((column, channel) => {
        scaled(gaussians.harmonics(0, channel), column, layout.steps.colour);
    });
    if (coefficients > 1) {
        fillHarmonics(codeOf, layout, gaussians);
    }
    requireSound(gaussians);
    if (sections.has("weights")) {
        gaussians.weighting = readWeighting(sections, count);
    } else if (sections.has("view")) {
        throw new Error('section "weights" of the .pgs is missing, which section "view" belongs to');
    }
    return gaussians;
}

/** How the columns of a section are read. @type {(section: Uint8Array) => import("./pgs_attributes.js").Code} */
function readingOf(section) {
    const coder = new RangeDecoder(section);
    return (_, contexts, neighbours) => coder.column(contexts, undefined, neighbours);
}

function layoutOf(sections) {
    const fields = sections.get("scene");
    if (fields?.length !== SCENE) {
        throw new Error(`section "scene" of the .pgs is missing or not of ${SCENE} bytes`);
    }
    const view = new DataView(fields.buffer, fields.byteOffset, fields.length);
    const [count, entries] = [view.getUint32(0, true), view.getUint32(4, true)];
    const [degree, bits] = [view.getUint8(8), view.getUint8(9)];
    const steps = [0, 1, 2, 3, 4].map((index) => view.getFloat32(24 + 4 * index, true));
    if (degree > 3) {
        throw new Error(`the .pgs has spherical harmonics of degree ${degree}, expected 0 to 3`);
    }
    const needed = ["position", "scale", "rotation", "opacity", "colour", ...(degree ? ["harmonic"] : [])];
    if (degree && entries) {
        needed.push("codebook");
    }
    const missing = needed.find((name) => !sections.has(name));
    if (missing) {
        throw new Error(`section "${missing}" of the .pgs is missing`);
    }
    if (!count) {
        throw new Error("the .pgs has 0 Gaussians, expected at least one");
    }
    if (count > MAX_NUMBER) {
        throw new Error(`the .pgs has ${count} Gaussians, expected at most ${MAX_NUMBER}`);
    }
    if (bits > MAX_BITS || entries > MAX_ENTRIES || !steps.every((step) => step > 0 && step < Infinity)) {
        throw new Error("the .pgs is broken: a field is out of range");
    }
    const coefficients = (degree + 1) ** 2;
    requireRoom(count, coefficients, DECODING * count);
    const [logScale, rotation, opacity, colour, harmonics] = steps;
    return {
        count,
        entries,
        coefficients,
        bits,
        exponent: view.getInt16(10, true),
        origin: [0, 1, 2].map((axis) => view.getInt32(12 + 4 * axis, true)),
        steps: { logScale, rotation, opacity, colour, harmonics },
    };
}

function scaled(column, levels, step, origin = 0) {
    for (let i = 0; i < column.length; i++) {
        column[i] = (levels[i] + origin) * step;
    }
}

function readRotations(code, table, scales, { count, steps }, gaussians) {
    const logScales = scales.map((column) => Float64Array.from(column, (level) => level * steps.logScale));
    const { swing, twist } = finenessOf(logScales);
    const [ps, rs, ts] = codeTurns(code, table, { swing, twist });
    const parts = [0, 1, 2, 3].map((part) => gaussians.column(QUATERNION + part));
    for (let i = 0; i < count; i++) {
        const [tilt, turn] = [stepOf(swing[i], steps.rotation), stepOf(twist[i], steps.rotation)];
        const quaternion = quaternionOf(ps[i] * tilt, rs[i] * tilt, ts[i] * turn);
        parts.forEach((column, part) => (column[i] = quaternion[part]));
    }
}

function fillHarmonics(codeOf, { count, entries, coefficients, steps }, gaussians) {
    const code = codeOf(entries ? "codebook" : "harmonic");
    const table = [0, 1, 2].map(() => new Int32Array(entries || count));
    const labels = entries ? codeOf("harmonic")(table[0], new Uint8Array(count)) : null;
    if (labels?.some((label) => label < 0 || label >= entries)) {
        throw new Error(`the .pgs is broken: an entry outside the codebook of ${entries}`);
    }
    for (let place = 1; place < coefficients; place++) {
        codeHarmonic(code, table).forEach((levels, channel) => {
            const column = gaussians.harmonics(place, channel);
            scaled(column, labels ? labels.map((label) => levels[label]) : levels, steps.harmonics);
        });
    }
}
