/**
 * Unpacking LZFSE, Apple's format, in which Record3D stores depth. The layout is that of Apple's reference
 * implementation (lzfse_internal.h): blocks of literals and matches, coded by finite state entropy, by LZVN, or stored.
 *
 * @module
 */

import { bitsAt } from "../../page/formats/bits.js";
import { BitsFromEnd, decoderOf, frequenciesOf } from "./finite_state.js";
import { Damaged, History } from "./history.js";
import { unpackLzvn } from "./lzvn.js";

/** A kind of symbols: of each symbol, the number of bits that follow it and the value that they are added to. */
const kindOf = (states, extras) => {
    let [base, bases] = [0, []];
    for (const extra of extras) {
        bases.push(base);
        base += 2 ** extra;
    }
    return { states, extras, bases };
};

const repeated = (count, value) => new Array(count).fill(value);

const LITERALS = kindOf(1024, repeated(256, 0));
const LITERAL_LENGTHS = kindOf(64, [...repeated(16, 0), 2, 3, 5, 8]);
const MATCH_LENGTHS = kindOf(64, [...repeated(16, 0), 3, 5, 8, 11]);
const DISTANCES = kindOf(256, Array.from({ length: 64 }, (_, symbol) => symbol >> 2));

const HEADER_SIZE = 32;
const MAX_MATCHES = 10_000;
const MAX_LITERALS = 4 * MAX_MATCHES;

/**
 * The content of a file, or null where it is damaged or of another size.
 *
 * @param {Uint8Array} bytes of the file
 * @param {number} size bytes of the content
 * @returns {Uint8Array | null}
 */
export function unpacked(bytes, size) {
    try {
        const history = new History(size);
        for (let at = 0; at !== null; ) {
            at = unpackBlock(bytes, at, history);
        }
        return history.filled === size ? history.bytes : null;
    } catch (error) {
        if (error instanceof Damaged) {
            return null;
        }
        throw error;
    }
}

/** Unpack the block that begins at a byte. Returns where the next one begins, or null after the last one. */
function unpackBlock(bytes, at, history) {
    const kind = String.fromCharCode(...bytes.subarray(at, at + 4));
    if (kind === "bvx$") {
        return null;
    }
    if (kind === "bvx-") {
        const size = unsignedAt(bytes, at + 4);
        history.append(bytes, at + 8, size);
        return at + 8 + size;
    }
    if (kind === "bvxn") {
        const end = at + 12 + unsignedAt(bytes, at + 8);
        unpackLzvn(part(bytes, at + 12, end), history);
        return end;
    }
    if (kind === "bvx2") {
        return unpackMatches(bytes, at, history);
    }
    throw new Damaged(`a block of the type ${kind}`);
}

/** Unpack a block of the second version of the format: literals, then how many of them each match follows. */
function unpackMatches(bytes, at, history) {
    const header = part(bytes, at, at + HEADER_SIZE);
    const field = (bit, count) => bitsAt(header, bit, count);
    const begin = at + unsignedAt(header, 24);
    const middle = begin + field(84, 20);
    const end = middle + field(168, 20);
    const [literalCount, matchCount] = [field(64, 20), field(104, 20)];
    if (literalCount > MAX_LITERALS || matchCount > MAX_MATCHES) {
        throw new Damaged(`a block of ${literalCount} literals and ${matchCount} matches`);
    }
    // The kinds of symbols follow each other in the order in which they are taken here.
    const frequencies = frequenciesOf(part(bytes, at + HEADER_SIZE, begin));
    const decoder = ({ states, extras, bases }, state) => {
        return decoderOf(states, frequencies.splice(0, extras.length), extras, bases, state);
    };
    const [lengths, matches, distances] = [
        decoder(LITERAL_LENGTHS, field(224, 10)),
        decoder(MATCH_LENGTHS, field(234, 10)),
        decoder(DISTANCES, field(244, 10)),
    ];
    const fours = [128, 138, 148, 158].map((bit) => field(bit, 10));
    const ofLiterals = new BitsFromEnd(part(bytes, begin, middle), 7 - field(124, 3));
    const literals = literalsOf(decoder(LITERALS, 0), fours, literalCount, ofLiterals);
    const ofMatches = new BitsFromEnd(part(bytes, middle, end), 7 - field(188, 3));
    let [used, distance] = [0, 0];
    for (let match = 0; match < matchCount; match++) {
        const [count, repeats] = [lengths.next(ofMatches), matches.next(ofMatches)];
        distance = distances.next(ofMatches) || distance;
        history.append(literals, used, count);
        history.repeat(distance, repeats);
        used += count;
    }
    return end;
}

/** Four decoders with one table take turns, each with a state of its own. */
function literalsOf(decoder, states, count, bits) {
    return Uint8Array.from({ length: count }, (_, i) => {
        decoder.state = states[i % 4];
        const literal = decoder.next(bits);
        states[i % 4] = decoder.state;
        return literal;
    });
}

function part(bytes, begin, end) {
    if (begin > end || end > bytes.length) {
        throw new Damaged("a block ends too early");
    }
    return bytes.subarray(begin, end);
}

function unsignedAt(bytes, at) {
    const four = part(bytes, at, at + 4);
    return new DataView(four.buffer, four.byteOffset).getUint32(0, true);
}
