/**
 * Headers of .ply files.
 *
 * @module
 */

/**
 * @typedef {Object} Header
 * @property {number} bytes its length
 * @property {string[][]} lines their words
 * @property {string | undefined} format
 * @property {string[][]} elements the lines that begin them
 *
 * @typedef {Object} Property
 * @property {string} type of its numbers, as `DataView` names it
 * @property {number} offset in the row, in bytes
 * @property {number} column in the row
 *
 * @typedef {{count: number, properties: Map<string, Property>, stride: number}} Rows `stride` in bytes
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

export const MAX_HEADER_BYTES = 1 << 16;

/**
 * @param {Uint8Array} start of the file
 * @returns {Header | null} null where it does not end
 */
export function readHeader(start) {
    const text = new TextDecoder("latin1").decode(start.subarray(0, MAX_HEADER_BYTES));
    const end = /^end_header\r?\n/m.exec(text);
    if (!end) {
        return null;
    }
    const lines = text.slice(0, end.index).split(/\r?\n/).map((line) => line.trim().split(/\s+/));
    const format = lines.find(([word]) => word === "format")?.[1];
    const elements = lines.filter(([word]) => word === "element");
    return { bytes: end.index + end[0].length, lines, format, elements };
}

/** Words that begin a line among an element's properties, besides theirs. */
const REMARKS = ["comment", "obj_info", ""];

/** Whether the file begins with vertices. @type {(header: Header) => boolean} */
export const beginsWithVertices = ({ elements: [first] }) => first?.[1] === "vertex" && /^\d+$/.test(first[2]);

/**
 * The rows that the file begins with.
 *
 * @param {Header} header of a file that begins with vertices
 * @param {string} whose they are, for messages
 * @returns {Rows}
 * @throws {Error} a property is not a number, or a line states none
 */
export function rowsOf({ lines, elements }, whose) {
    const begin = lines.indexOf(elements[0]) + 1;
    const end = elements[1] ? lines.indexOf(elements[1]) : lines.length;
    const properties = new Map();
    let stride = 0;
    for (const line of lines.slice(begin, end).filter(([word]) => !REMARKS.includes(word))) {
        const [word, type, name] = line;
        if (word === "property" && !Object.hasOwn(TYPES, type)) {
            throw new Error(`${whose} vertices have a property of type ${type}, expected numbers`);
        }
        // Every row has the bytes of all properties, so one that is not understood would shift the others.
        if (word !== "property" || line.length !== 3 || properties.has(name)) {
            const found = line.join(" ").slice(0, 80);
            throw new Error(`${whose} header holds "${found}", expected a property with a type and a name of its own`);
        }
        const [size, method] = TYPES[type];
        properties.set(name, { type: method, offset: stride, column: properties.size });
        stride += size;
    }
    return { count: Number(elements[0][2]), properties, stride };
}
