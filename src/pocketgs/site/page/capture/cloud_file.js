/**
 * Reader of point clouds in .ply files, binary or text; see `capture/cloud_file.py`.
 *
 * @module
 */

/** Sizes of scalar types in bytes, their names in a `DataView`, and what full intensity is. */
const TYPES = {
    char: [1, "Int8", 255],
    int8: [1, "Int8", 255],
    uchar: [1, "Uint8", 255],
    uint8: [1, "Uint8", 255],
    short: [2, "Int16", 255],
    int16: [2, "Int16", 255],
    ushort: [2, "Uint16", 255],
    uint16: [2, "Uint16", 255],
    int: [4, "Int32", 255],
    int32: [4, "Int32", 255],
    uint: [4, "Uint32", 255],
    uint32: [4, "Uint32", 255],
    float: [4, "Float32", 1],
    float32: [4, "Float32", 1],
    double: [8, "Float64", 1],
    float64: [8, "Float64", 1],
};

const MAX_HEADER_BYTES = 1 << 16;
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
    const header = readHeader(bytes, file.path);
    const names = [...header.properties.keys()];
    if (!POSITION.every((name) => names.includes(name))) {
        throw new Error(`${file.path}: not a point cloud, expected vertices with x, y, z`);
    }
    const hasColour = COLOUR.every((name) => names.includes(name));
    const rows = header.format === "ascii" ? textRows(bytes, header, file.path) : binaryRows(bytes, header, file.path);
    const positions = new Float64Array(3 * header.count);
    const colours = new Float32Array(3 * header.count).fill(bounds.unknown_colour);
    const full = hasColour ? COLOUR.map((name) => TYPES[header.properties.get(name).type][2]) : [];
    for (let i = 0; i < header.count; i++) {
        for (let axis = 0; axis < 3; axis++) {
            positions[3 * i + axis] = rows(i, POSITION[axis]);
            if (hasColour) {
                colours[3 * i + axis] = Math.min(Math.max(rows(i, COLOUR[axis]) / full[axis] || 0, 0), 1);
            }
        }
    }
    if (!positions.every((value) => Math.abs(value) < bounds.max_coordinate)) {
        throw new Error(`${file.path}: holds NaN or coordinates beyond ${bounds.max_coordinate}`);
    }
    return header.count ? { positions, colours } : null;
}

function readHeader(bytes, path) {
    const text = new TextDecoder("latin1").decode(bytes.subarray(0, MAX_HEADER_BYTES));
    const end = /^end_header\r?\n/m.exec(text);
    const lines = (end ? text.slice(0, end.index) : "").split(/\r?\n/).map((line) => line.trim().split(/\s+/));
    const format = lines.find(([word]) => word === "format")?.[1];
    const elements = lines.filter(([word]) => word === "element");
    const known = ["ascii", "binary_little_endian", "binary_big_endian"].includes(format);
    if (!known || elements[0]?.[1] !== "vertex" || !/^\d+$/.test(elements[0][2])) {
        throw new Error(`${path}: not a readable .ply, expected one that begins with vertices`);
    }
    const last = elements[1] ? lines.indexOf(elements[1]) : lines.length;
    const properties = new Map();
    let stride = 0;
    for (const [word, type, name] of lines.slice(lines.indexOf(elements[0]) + 1, last)) {
        if (word === "property") {
            if (!(type in TYPES)) {
                throw new Error(`${path}: its vertices have a property of type ${type}, expected numbers`);
            }
            properties.set(name, { type, offset: stride, column: properties.size });
            stride += TYPES[type][0];
        }
    }
    return { format, count: Number(elements[0][2]), properties, stride, start: end.index + end[0].length };
}

function binaryRows(bytes, { format, count, properties, stride, start }, path) {
    if (start + count * stride > bytes.length) {
        throw cutShort(path, bytes.length, count);
    }
    const view = new DataView(bytes.buffer, bytes.byteOffset + start);
    const isLittle = format === "binary_little_endian";
    return (row, name) => {
        const { type, offset } = properties.get(name);
        return view[`get${TYPES[type][1]}`](row * stride + offset, isLittle);
    };
}

function textRows(bytes, { count, properties, start }, path) {
    const numbers = new TextDecoder("latin1").decode(bytes.subarray(start)).trim().split(/\s+/).map(Number);
    if (numbers.length < count * properties.size) {
        throw cutShort(path, bytes.length, count);
    }
    return (row, name) => numbers[row * properties.size + properties.get(name).column];
}

function cutShort(path, bytes, count) {
    return new Error(`${path}: is cut short: its ${bytes} bytes cannot hold ${count} points`);
}
