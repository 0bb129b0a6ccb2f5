/**
 * The `.ply` of the reference 3DGS implementation, and with weights; the twin of `formats/ply.py` and
 * `sort_free/ply_file.py`.
 *
 * @module
 */

import { GaussianColumns, LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../scene/gaussian_columns.js";
import { Weighting, numbersOf } from "../scene/weighting.js";

/**
 * @typedef {import("./byte_stream.js").ByteStream} ByteStream
 * @typedef {import("./scene_file.js").PartListener} PartListener
 */

/** Sizes of scalar types in bytes, and their names in a `DataView`. */
const TYPES = {
    char: [1, "Int8"],
    int8: [1, "Int8"],
    uchar: [1, "Uint8"],
    uint8: [1, "Uint8"],
    short: [2, "Int16"],
    int16: [2, "Int16"],
    ushort: [2, "Uint16"],
    uint16: [2, "Uint16"],
    int: [4, "Int32"],
    int32: [4, "Int32"],
    uint: [4, "Uint32"],
    uint32: [4, "Uint32"],
    float: [4, "Float32"],
    float32: [4, "Float32"],
    double: [8, "Float64"],
    float64: [8, "Float64"],
};

const MAX_HEADER_BYTES = 1 << 16;
const ROWS_AT_ONCE = 1 << 11;
const COEFFICIENTS = { 0: 1, 9: 4, 24: 9, 45: 16 };

/**
 * Read a scene.
 *
 * @param {ByteStream} source at the start of the file
 * @param {number} bytes the file's size
 * @param {PartListener} onPart
 * @returns {Promise<GaussianColumns>}
 * @throws {Error} it is broken, or holds no Gaussians
 */
export async function readPly(source, bytes, onPart) {
    const { count, properties, stride, littleEndian, comments } = parseHeader(await takeHeader(source));
    if (count * stride > bytes) {
        throw new Error(`the file is cut short: ${bytes} bytes cannot hold ${count} Gaussians of ${stride} bytes`);
    }
    const rest = [...properties.keys()].filter((name) => name.startsWith("f_rest_")).length;
    if (!(rest in COEFFICIENTS)) {
        throw new Error(`the .ply has ${rest} f_rest properties, expected 0, 9, 24 or 45`);
    }
    const gaussians = new GaussianColumns(count, COEFFICIENTS[rest]);
    gaussians.weighting = weightingIn(comments, properties, count);
    const targets = targetsIn(gaussians, properties);
    for (let first = 0; first < count; first += ROWS_AT_ONCE) {
        const rows = Math.min(ROWS_AT_ONCE, count - first);
        const view = new DataView((await source.take(rows * stride)).buffer);
        for (const { property, values } of targets) {
            const read = view[`get${property.type}`].bind(view);
            for (let row = 0; row < rows; row++) {
                values[first + row] = read(row * stride + property.offset, littleEndian);
            }
        }
        onPart(gaussians, first + rows);
    }
    gaussians.normaliseQuaternions();
    return gaussians;
}

async function takeHeader(source) {
    const start = await source.takeUpTo(MAX_HEADER_BYTES);
    const text = new TextDecoder("latin1").decode(start);
    const end = /^end_header\r?\n/m.exec(text);
    if (!end) {
        throw new Error("the .ply's header does not end");
    }
    const length = end.index + end[0].length;
    source.putBack(start.slice(length));
    return text.slice(0, length);
}

function parseHeader(text) {
    const lines = text.split(/\r?\n/).map((line) => line.trim().split(/\s+/));
    const format = lines.find(([word]) => word === "format")?.[1];
    if (format !== "binary_little_endian" && format !== "binary_big_endian") {
        throw new Error(`the .ply's format is ${format}, expected a binary one`);
    }
    const elements = lines.filter(([word]) => word === "element");
    if (elements.some(([, name]) => name === "chunk")) {
        throw new Error("the .ply is a compressed one, expected one of the reference 3DGS layout; convert it first");
    }
    if (elements[0]?.[1] !== "vertex" || !/^\d+$/.test(elements[0][2])) {
        throw new Error(`the .ply begins with element '${elements[0]?.[1]}', expected 'vertex'`);
    }
    const begin = lines.indexOf(elements[0]) + 1;
    const end = elements[1] ? lines.indexOf(elements[1]) : lines.length;
    const properties = new Map();
    let stride = 0;
    for (const [, type, name] of lines.slice(begin, end).filter(([word]) => word === "property")) {
        if (!(type in TYPES)) {
            throw new Error(`the .ply's vertices have a property of type ${type}, expected numbers`);
        }
        const [size, method] = TYPES[type];
        properties.set(name, { type: method, offset: stride });
        stride += size;
    }
    const pairs = lines.filter((words) => words[0] === "comment" && words.length === 3);
    const comments = new Map(pairs.map(([, ...of]) => of));
    const littleEndian = format === "binary_little_endian";
    return { count: Number(elements[0][2]), properties, stride, littleEndian, comments };
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

/** The target column of each property. */
function targetsIn(gaussians, properties) {
    const columns = new Map([["opacity", gaussians.column(OPACITY_LOGIT)]]);
    ["x", "y", "z"].forEach((name, axis) => columns.set(name, gaussians.column(MEAN + axis)));
    for (let axis = 0; axis < 3; axis++) {
        columns.set(`scale_${axis}`, gaussians.column(LOG_SCALE + axis));
        columns.set(`f_dc_${axis}`, gaussians.harmonics(0, axis));
    }
    for (let part = 0; part < 4; part++) {
        columns.set(`rot_${part}`, gaussians.column(QUATERNION + part));
    }
    const higher = gaussians.coefficients - 1;
    for (let i = 0; i < 3 * higher; i++) {
        columns.set(`f_rest_${i}`, gaussians.harmonics(1 + (i % higher), Math.floor(i / higher)));
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
