/**
 * Zstandard decompression (RFC 8878), which not every browser supports: `.spz` version 4 uses it.
 *
 * @module
 */

import { BackwardBits, decodeHuffman, readHuffmanTable, readStateTable, stateTable } from "./zstd_entropy.js";

const FRAME_MAGIC = 0xfd2fb528;
const MAX_BLOCK = 1 << 17;

/** Extra bits and base values of the codes of literal lengths and match lengths (section 3.1.1.3.2.1). */
const LITERALS = lengthCodes(0, [...Array(16).fill(0), 1, 1, 1, 1, 2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]);
const MATCHES = lengthCodes(3, [...Array(32).fill(0), 1, 1, 1, 1, 2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]);

/** The default distributions (section 3.1.1.3.2.2), and the maximum accuracy of explicit ones. */
const KINDS = {
    literals: {
        mostAccuracy: 9,
        usual: stateTable(
            [4, 3, ...Array(11).fill(2), 1, 1, 1, ...Array(9).fill(2), 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1],
            6,
        ),
    },
    offsets: {
        mostAccuracy: 8,
        usual: stateTable([1, 1, 1, 1, 1, 1, 2, 2, 2, ...Array(15).fill(1), ...Array(5).fill(-1)], 5),
    },
    matches: {
        mostAccuracy: 9,
        usual: stateTable([1, 4, 3, 2, 2, 2, 2, 2, 2, ...Array(37).fill(1), ...Array(7).fill(-1)], 6),
    },
};

function lengthCodes(least, bits) {
    const bases = [];
    bits.reduce((base, extra) => (bases.push(base), base + 2 ** extra), least);
    return { bits, bases };
}

/**
 * Decompress one frame.
 *
 * @param {Uint8Array} bytes
 * @param {number} size of the decompressed content
 * @returns {Uint8Array}
 * @throws {Error} it is broken, or of another size
 */
export function unpackZstd(bytes, size) {
    if (bytes.length < 9 || new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true) !== FRAME_MAGIC) {
        throw new Error("not a Zstandard stream");
    }
    const state = { output: new Uint8Array(size), end: 0, repeated: [1, 4, 8], huffman: null, tables: {} };
    let place = headerSize(bytes[4]);
    for (let isLast = false; !isLast; ) {
        const header = bytes[place] | (bytes[place + 1] << 8) | (bytes[place + 2] << 16);
        const [kind, length] = [(header >> 1) & 3, header >> 3];
        isLast = Boolean(header & 1);
        place += 3;
        const content = bytes.subarray(place, place + (kind === 1 ? 1 : length));
        if (kind === 3 || length > MAX_BLOCK || place + content.length > bytes.length || !content.length !== !length) {
            throw new Error("a Zstandard block is broken");
        }
        if (kind === 2) {
            unpackBlock(content, state);
        } else {
            append(state, kind === 1 ? new Uint8Array(length).fill(content[0]) : content);
        }
        place += content.length;
    }
    if (state.end !== size) {
        throw new Error(`a Zstandard stream holds ${state.end} bytes, expected ${size}`);
    }
    return state.output;
}

function headerSize(descriptor) {
    const isWhole = (descriptor >> 5) & 1;
    return 5 + (isWhole ? 0 : 1) + [0, 1, 2, 4][descriptor & 3] + [isWhole, 2, 4, 8][descriptor >> 6];
}

function append(state, bytes) {
    if (state.end + bytes.length > state.output.length) {
        throw new Error(`a Zstandard stream holds more than the ${state.output.length} bytes expected`);
    }
    state.output.set(bytes, state.end);
    state.end += bytes.length;
}

function unpackBlock(content, state) {
    const { literals, size } = takeLiterals(content, state);
    const rest = content.subarray(size);
    const [count, start] = sequenceCount(rest);
    let taken = 0;
    if (count) {
        taken = copySequences(rest.subarray(start), count, literals, state);
    }
    append(state, literals.subarray(taken));
}

function takeLiterals(content, state) {
    const [kind, format] = [content[0] & 3, (content[0] >> 2) & 3];
    const number = content.subarray(0, 5).reduce((sum, byte, i) => sum + byte * 256 ** i, 0);
    const field = (first, bits) => Math.floor(number / 2 ** first) % 2 ** bits;
    if (kind < 2) {
        const [start, length] = [[1, field(3, 5)], [2, field(4, 12)], [1, field(3, 5)], [3, field(4, 20)]][format];
        const end = start + (kind ? 1 : length);
        return { literals: kind ? new Uint8Array(length).fill(content[start]) : content.slice(start, end), size: end };
    }
    const bits = [10, 10, 14, 18][format];
    const start = [3, 3, 4, 5][format];
    const [length, packed] = [field(4, bits), field(4 + bits, bits)];
    let body = content.subarray(start, start + packed);
    if (kind === 2) {
        const { table, size } = readHuffmanTable(body);
        state.huffman = table;
        body = body.subarray(size);
    }
    if (!state.huffman || length > MAX_BLOCK) {
        throw new Error("a Zstandard block has no code");
    }
    const literals = new Uint8Array(length);
    if (format === 0) {
        decodeHuffman(state.huffman, body, literals);
    } else {
        decodeFour(state.huffman, body, literals);
    }
    return { literals, size: start + packed };
}

function decodeFour(table, body, literals) {
    const sizes = [0, 2, 4].map((place) => body[place] | (body[place + 1] << 8));
    const quarter = Math.ceil(literals.length / 4);
    let place = 6;
    for (let i = 0; i < 4; i++) {
        const end = i < 3 ? place + sizes[i] : body.length;
        const target = literals.subarray(i * quarter, i < 3 ? (i + 1) * quarter : literals.length);
        decodeHuffman(table, body.subarray(place, end), target);
        place = end;
    }
}

function sequenceCount([a, b, c]) {
    if (a < 128) {
        return [a, 1];
    }
    return a < 255 ? [((a - 128) << 8) + b, 2] : [b + (c << 8) + 0x7f00, 3];
}

/** Copy literals and earlier output in turn (section 3.1.1.4); returns how many literals that took. */
function copySequences(content, count, literals, state) {
    const modes = content[0];
    let place = 1;
    const [literal, offset, match] = Object.entries(KINDS).map(([name, kind], i) => {
        const { table, size } = sequenceTable((modes >> (6 - 2 * i)) & 3, content.subarray(place), kind, state.tables[name]);
        place += size;
        state.tables[name] = table;
        return { table, state: 0 };
    });
    const source = new BackwardBits(content.subarray(place));
    [literal, offset, match].forEach((one) => (one.state = source.read(one.table.accuracy)));
    let taken = 0;
    for (let i = 0; i < count; i++) {
        const [l, o, m] = [literal, offset, match].map((one) => one.table.symbols[one.state]);
        const stated = 2 ** o + source.read(o);
        const length = MATCHES.bases[m] + source.read(MATCHES.bits[m]);
        const before = LITERALS.bases[l] + source.read(LITERALS.bits[l]);
        append(state, literals.subarray(taken, taken + before));
        taken += before;
        repeat(state, distance(state.repeated, stated, before), length);
        if (i + 1 < count) {
            [literal, match, offset].forEach((one) => {
                one.state = one.table.bases[one.state] + source.read(one.table.bits[one.state]);
            });
        }
    }
    if (source.left !== 0 || taken > literals.length) {
        throw new Error("a Zstandard block does not end where it should");
    }
    return taken;
}

function sequenceTable(mode, content, { usual, mostAccuracy }, previous) {
    if (mode === 0) {
        return { table: usual, size: 0 };
    }
    if (mode === 1) {
        const only = { accuracy: 0, symbols: content.slice(0, 1), bits: new Uint8Array(1), bases: new Uint16Array(1) };
        return { table: only, size: 1 };
    }
    if (mode === 2) {
        return readStateTable(content, mostAccuracy);
    }
    if (!previous) {
        throw new Error("a Zstandard block repeats a table that there is not");
    }
    return { table: previous, size: 0 };
}

/** The distance of a match; small codes stand for the last distances used (section 3.1.1.5). */
function distance(repeated, stated, literals) {
    if (stated > 3) {
        repeated.unshift(stated - 3);
        repeated.pop();
        return repeated[0];
    }
    const which = stated - 1 + (literals === 0 ? 1 : 0);
    const found = which === 3 ? repeated[0] - 1 : repeated[which];
    if (which > 0) {
        repeated.splice(Math.min(which, 2), 1);
        repeated.unshift(found);
    }
    return found;
}

/** Append the output from `back` bytes ago; it may overlap what is being written. */
function repeat(state, back, length) {
    const { output, end } = state;
    if (back < 1 || back > end || end + length > output.length) {
        throw new Error("a Zstandard stream points outside of itself");
    }
    for (let i = end; i < end + length; i++) {
        output[i] = output[i - back];
    }
    state.end = end + length;
}
