/**
 * The `.ply` of the reference 3DGS implementation, and with weights; the twin of `formats/ply.py` and
 * `sort_free/ply_file.py`.
 *
 * @module
 */

import { LOG_SCALE } from "../constants.js";
import { GaussianColumns, MIN_SCALE } from "../scene/gaussian_columns.js";
import { Weighting, numbersOf } from "../scene/weighting.js";
import { isMarked } from "./antialiased.js";
import { columnsOf } from "./ply_columns.js";
import { MAX_HEADER_BYTES, beginsWithVertices, readHeader, rowsOf } from "./ply_header.js";

/**
 * @typedef {import("./byte_stream.js").ByteStream} ByteStream
 * @typedef {import("./scene_file.js").PartListener} PartListener
 */

const ROWS_AT_ONCE = 1 << 11;
/** Coefficients of each channel by the number of properties: those of degree 4 are dropped. */
const COEFFICIENTS = { 0: 1, 9: 4, 24: 9, 45: 16, 72: 16 };

/** Logarithm of the thickness of a Gaussian that has two axes, relative to the smaller one. */
const FLATNESS = Math.log(1e-3);

const MIN_LOG_SCALE = Math.log(MIN_SCALE);

/**
 * Read a scene. The Gaussians of 2DGS have two axes: they become thin discs.
 *
 * @param {ByteStream} source at the start of the file
 * @param {number} bytes the file's size
 * @param {PartListener} onPart
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} it is broken, or holds no Gaussians
 */
export async function readPly(source, bytes, onPart) {
    const header = await takeHeader(source);
    const { count, properties, stride, littleEndian, comments } = verticesIn(header);
    if (count * stride > bytes) {
        throw new Error(`the file is cut short: ${bytes} bytes cannot hold ${count} Gaussians of ${stride} bytes`);
    }
    const rest = [...properties.keys()].filter((name) => name.startsWith("f_rest_")).length;
    if (!(rest in COEFFICIENTS)) {
        throw new Error(`the .ply has ${rest} f_rest properties, expected 0, 9, 24, 45 or 72`);
    }
    const gaussians = new GaussianColumns(count, COEFFICIENTS[rest]);
    gaussians.weighting = weightingIn(comments, properties, count);
    gaussians.isAntialiased = isMarked(header.lines);
    const isFlat = !properties.has("scale_2");
    const targets = targetsIn(gaussians, properties, isFlat, 1 + rest / 3);
    for (let first = 0; first < count; first += ROWS_AT_ONCE) {
        const rows = Math.min(ROWS_AT_ONCE, count - first);
        const view = new DataView((await source.take(rows * stride)).buffer);
        for (const { property, values } of targets) {
            const read = view[`get${property.type}`].bind(view);
            for (let row = 0; row < rows; row++) {
                values[first + row] = read(row * stride + property.offset, littleEndian);
            }
        }
        completeLogScales(gaussians, isFlat, first, first + rows);
        onPart(gaussians, first + rows);
    }
    gaussians.normaliseQuaternions();
    return gaussians;
}

async function takeHeader(source) {
    const start = await source.takeUpTo(MAX_HEADER_BYTES);
    const header = readHeader(start);
    if (!header) {
        throw new Error("the .ply's header does not end");
    }
    source.putBack(start.slice(header.bytes));
    return header;
}

function verticesIn(header) {
    const { format, elements, lines } = header;
    if (format !== "binary_little_endian" && format !== "binary_big_endian") {
        throw new Error(`the .ply's format is ${format}, expected a binary one; convert it first`);
    }
    if (elements.some(([, name]) => name === "chunk")) {
        throw new Error("the .ply is a compressed one, expected one of the reference 3DGS layout; convert it first");
    }
    if (!beginsWithVertices(header)) {
        throw new Error(`the .ply begins with element '${elements[0]?.[1]}', expected 'vertex'; convert it first`);
    }
    const pairs = lines.filter((words) => words[0] === "comment" && words.length === 3);
    const comments = new Map(pairs.map(([, ...of]) => of));
    return { ...rowsOf(header, "the .ply's"), littleEndian: format === "binary_little_endian", comments };
}

/** Room for the weights that the header states, or null. */
function weightingIn(comments, properties, count) {
    const form = comments.get("sort_free");
    if (form === undefined) {
        return null;
    }
    const valueOf = (name) => Number(comments.get(`sort_free_${name}`));
    let coefficients = 0;
    while (properties.has(`view_${coefficients}`)) {
        coefficients++;
    }
    return new Weighting(form, valueOf("unit"), numbersOf(form).map(valueOf), coefficients, count);
}

/** Give Gaussians of two axes a third one, and those of a thickness of 0 a finite logarithm, to be drawn. */
function completeLogScales(gaussians, isFlat, first, end) {
    const columns = [0, 1, 2].map((axis) => gaussians.column(LOG_SCALE + axis).subarray(first, end));
    if (isFlat) {
        const [xs, ys, zs] = columns;
        xs.forEach((x, i) => (zs[i] = Math.min(x, ys[i]) + FLATNESS));
    }
    for (const column of columns) {
        column.forEach((logScale, i) => (column[i] = logScale === -Infinity ? MIN_LOG_SCALE : logScale));
    }
}

/** The target column of each property; of 2DGS, none is that of the third scale, and none those of degree 4. */
function targetsIn(gaussians, properties, isFlat, stored) {
    const columns = columnsOf(gaussians, stored);
    if (isFlat) {
        columns.delete("scale_2");
    }
    for (let k = 0; k < (gaussians.weighting?.coefficients ?? 0); k++) {
        columns.set(`view_${k}`, gaussians.weighting.column(k));
    }
    return [...columns].map(([name, values]) => {
        if (!properties.has(name)) {
            throw new Error(`the .ply holds no Gaussians: its vertices have no property '${name}'`);
        }
        return { property: properties.get(name), values };
    });
}
