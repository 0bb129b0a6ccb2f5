/**
 * The two entropy codes of Zstandard (RFC 8878, section 4): finite-state entropy and Huffman.
 *
 * @module
 */

import { bitsAt } from "./bits.js";

/** Reads bits forward from the first byte, lowest first. */
class ForwardBits {
    /** @param {Uint8Array} bytes */
    constructor(bytes) {
        this.bytes = bytes;
        this.position = 0;
    }

    peek(count) {
        return bitsAt(this.bytes, this.position, count);
    }

    read(count) {
        const value = this.peek(count);
        this.position += count;
        return value;
    }
}

/** Reads bits backward from the last byte; its highest set bit marks the end. */
export class BackwardBits {
    /**
     * @param {Uint8Array} bytes
     * @throws {Error} the mark is missing
     */
    constructor(bytes) {
        const last = bytes.at(-1);
        if (!last) {
            throw new Error("a Zstandard bit stream has no end");
        }
        this.bytes = bytes;
        /** Number of bits left. */
        this.left = 8 * bytes.length - 1 - Math.clz32(last << 24);
    }

    /** Peek at up to 25 bits; those beyond the stream are 0. */
    peek(count) {
        const first = this.left - count;
        return first >= 0 ? bitsAt(this.bytes, first, count) : bitsAt(this.bytes, 0, this.left) << -first;
    }

    read(count) {
        if (count > 16) {
            const high = this.read(count - 16);
            return high * 65_536 + this.read(16);
        }
        const value = this.left > 0 ? this.peek(count) : 0;
        this.left -= count;
        return value;
    }
}

const highestBit = (value) => 31 - Math.clz32(value);

/**
 * @typedef {Object} StateTable decoding table of finite-state entropy: the symbol and next state of every state
 * @property {number} accuracy log2 of the number of states
 * @property {Uint8Array} symbols
 * @property {Uint8Array} bits to read
 * @property {Uint16Array} bases of the next state, to add the bits to
 */

/**
 * Make the table of a distribution (section 4.1.1).
 *
 * @param {number[]} counts of states by symbol; -1 means less than one
 * @param {number} accuracy
 * @returns {StateTable}
 */
export function stateTable(counts, accuracy) {
    const size = 1 << accuracy;
    const table = { accuracy, symbols: new Uint8Array(size), bits: new Uint8Array(size), bases: new Uint16Array(size) };
    let end = size;
    const next = counts.map((count, symbol) => {
        if (count === -1) {
            table.symbols[--end] = symbol;
        }
        return Math.abs(count);
    });
    const step = (size >> 1) + (size >> 3) + 3;
    let place = 0;
    counts.forEach((count, symbol) => {
        for (let k = 0; k < count; k++) {
            table.symbols[place] = symbol;
            do {
                place = (place + step) & (size - 1);
            } while (place >= end);
        }
    });
    for (let state = 0; state < size; state++) {
        const count = next[table.symbols[state]]++;
        table.bits[state] = accuracy - highestBit(count);
        table.bases[state] = (count << table.bits[state]) - size;
    }
    return table;
}

/**
 * Read a distribution, and make its table.
 *
 * @param {Uint8Array} bytes
 * @param {number} mostAccuracy
 * @returns {{table: StateTable, size: number}} with the number of bytes read
 * @throws {Error} it is broken
 */
export function readStateTable(bytes, mostAccuracy) {
    const source = new ForwardBits(bytes);
    const accuracy = source.read(4) + 5;
    const counts = [];
    let left = 1 << accuracy;
    while (left > 0 && accuracy <= mostAccuracy && counts.length < 256) {
        const bits = highestBit(left + 1) + 1;
        const short = 2 ** (bits - 1) - 1;
        const threshold = 2 ** bits - 2 - left;
        let value = source.peek(bits);
        if ((value & short) < threshold) {
            value &= short;
            source.position += bits - 1;
        } else {
            value -= value > short ? threshold : 0;
            source.position += bits;
        }
        counts.push(value - 1);
        left -= Math.abs(value - 1);
        for (let repeat = value === 1 ? 3 : 0; repeat === 3; ) {
            repeat = source.read(2);
            counts.push(...Array(repeat).fill(0));
        }
    }
    const size = Math.ceil(source.position / 8);
    if (left !== 0 || size > bytes.length) {
        throw new Error("a Zstandard table is broken");
    }
    return { table: stateTable(counts, accuracy), size };
}

/**
 * @typedef {Object} HuffmanTable
 * @property {number} depth bits of the longest code
 * @property {Uint8Array} symbols by the next `depth` bits
 * @property {Uint8Array} bits length of the code
 */

/**
 * Read a Huffman code (section 4.2.1).
 *
 * @param {Uint8Array} bytes
 * @returns {{table: HuffmanTable, size: number}} with the number of bytes read
 * @throws {Error} it is broken
 */
export function readHuffmanTable(bytes) {
    const header = bytes[0];
    const packed = header >= 128;
    const size = 1 + (packed ? (header - 126) >> 1 : header);
    const content = bytes.subarray(1, size);
    const weights = packed
        ? Array.from({ length: header - 127 }, (_, i) => (i % 2 ? content[i >> 1] & 15 : content[i >> 1] >> 4))
        : weightsFromStates(content);
    const sum = weights.reduce((total, weight) => total + (weight && 2 ** (weight - 1)), 0);
    const depth = highestBit(sum) + 1;
    const missing = 2 ** depth - sum;
    if (!sum || depth > 11 || missing & (missing - 1) || size > bytes.length) {
        throw new Error("a Zstandard code is broken");
    }
    weights.push(highestBit(missing) + 1);
    const table = { depth, symbols: new Uint8Array(2 ** depth), bits: new Uint8Array(2 ** depth) };
    let place = 0;
    for (let weight = 1; weight <= depth; weight++) {
        weights.forEach((found, symbol) => {
            if (found === weight) {
                const end = place + 2 ** (weight - 1);
                table.symbols.fill(symbol, place, end);
                table.bits.fill(depth + 1 - weight, place, end);
                place = end;
            }
        });
    }
    return { table, size };
}

/** Decode weights with two alternating states until the bits run out. */
function weightsFromStates(content) {
    const { table, size } = readStateTable(content, 6);
    const source = new BackwardBits(content.subarray(size));
    const states = [source.read(table.accuracy), source.read(table.accuracy)];
    const weights = [];
    for (let turn = 0; weights.length < 255; turn = 1 - turn) {
        const state = states[turn];
        weights.push(table.symbols[state]);
        states[turn] = table.bases[state] + source.read(table.bits[state]);
        if (source.left < 0) {
            weights.push(table.symbols[states[1 - turn]]);
            break;
        }
    }
    return weights;
}

/**
 * Decode one stream of a Huffman code.
 *
 * @param {HuffmanTable} table
 * @param {Uint8Array} bytes
 * @param {Uint8Array} target to fill
 * @throws {Error} the stream is shorter or longer than what it should fill
 */
export function decodeHuffman({ depth, symbols, bits }, bytes, target) {
    const source = new BackwardBits(bytes);
    for (let i = 0; i < target.length; i++) {
        const code = source.left > 0 ? source.peek(depth) : 0;
        target[i] = symbols[code];
        source.left -= bits[code];
    }
    if (source.left !== 0) {
        throw new Error("a Zstandard stream does not end where it should");
    }
}
