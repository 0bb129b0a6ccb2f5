/**
 * Reader of point clouds in .ply files, binary or text; see `capture/decoding/cloud_file.py`.
 *
 * @module
 */

import { beginsWithVertices, readHeader, rowsOf } from "../../page/formats/ply_header.js";
import { soundCloud } from "./listing.js";

const FORMATS = ["ascii", "binary_little_endian", "binary_big_endian"];
const POSITION = ["x", "y", "z"];
const COLOUR = ["red", "green", "blue"];

/**
 * @param {import("../archive/tree.js").StoredFile} file
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<import("./listing.js").Cloud | null>} null where it holds no point
 * @throws {Error} it is no .ply with vertices that have x, y and z
 */
export async function readCloud(file, bounds) {
    const bytes = await file.bytes();
    const header = readHeader(bytes);
    if (!FORMATS.includes(header?.format) || !beginsWithVertices(header)) {
        throw new Error(`${file.path}: not a readable .ply, expected one that begins with vertices`);
    }
    const rows = rowsOf(header, `${file.path}: its`);
    const { count, properties } = rows;
    if (!POSITION.every((name) => properties.has(name))) {
        throw new Error(`${file.path}: not a point cloud, expected vertices with x, y, z`);
    }
    const hasColour = COLOUR.every((name) => properties.has(name));
    const found = header.format === "ascii" ? inText : inBinary;
    const numberAt = found(bytes, header, rows, file);
    const positions = new Float64Array(3 * count);
    const colours = new Float32Array(3 * count).fill(bounds.unknown_colour);
    const full = hasColour ? fullColour(properties, numberAt, count, bounds) : 1;
    for (let i = 0; i < count; i++) {
        for (let axis = 0; axis < 3; axis++) {
            positions[3 * i + axis] = numberAt(i, POSITION[axis]);
            if (hasColour) {
                colours[3 * i + axis] = Math.min(Math.max(numberAt(i, COLOUR[axis]) / full || 0, 0), 1);
            }
        }
    }
    return soundCloud({ positions, colours }, file, bounds);
}

/** What full colour is in numbers of the colours' type; see `capture/decoding/cloud_file.py`. */
function fullColour(properties, numberAt, count, { largest_fraction: fraction }) {
    let most = 0;
    for (let i = 0; i < count; i++) {
        for (const name of COLOUR) {
            const value = numberAt(i, name);
            most = Number.isFinite(value) ? Math.max(most, value) : most;
        }
    }
    const [kind, bits] = /^(Float|Uint|Int)(\d+)$/.exec(properties.get(COLOUR[0]).type).slice(1);
    if (kind === "Float") {
        return most > fraction ? 255 : 1;
    }
    return most <= 255 ? 255 : 2 ** (kind === "Int" ? bits - 1 : bits) - 1;
}

function inBinary(bytes, { bytes: start, format }, { count, properties, stride }, { path }) {
    if (start + count * stride > bytes.length) {
        throw cutShort(path, bytes.length, count);
    }
    const view = new DataView(bytes.buffer, bytes.byteOffset + start);
    const isLittle = format === "binary_little_endian";
    return (row, name) => {
        const { type, offset } = properties.get(name);
        return view[`get${type}`](row * stride + offset, isLittle);
    };
}

function inText(bytes, { bytes: start }, { count, properties }, { path }) {
    const numbers = new TextDecoder("latin1").decode(bytes.subarray(start)).trim().split(/\s+/).map(Number);
    if (numbers.length < count * properties.size) {
        throw cutShort(path, bytes.length, count);
    }
    return (row, name) => numbers[row * properties.size + properties.get(name).column];
}

function cutShort(path, bytes, count) {
    return new Error(`${path}: is cut short: its ${bytes} bytes cannot hold ${count} points`);
}
