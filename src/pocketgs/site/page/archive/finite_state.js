/**
 * Finite state entropy decoding, as in LZFSE (lzfse_fse.h of Apple's reference implementation): a decoder's state gives
 * a symbol and, together with some bits, the next state.
 *
 * @module
 */

import { bitsAt } from "../../page/formats/bits.js";
import { Damaged } from "./history.js";

/** How many bits a frequency takes, and its value, by its first five bits; 8 and 14 bits hold the value themselves. */
const FREQUENCY_BITS = [2, 3, 2, 5, 2, 3, 2, 8, 2, 3, 2, 5, 2, 3, 2, 14];
const FREQUENCIES = [4, 5, 6, 7].flatMap((value) => [0, 2, 1, value, 0, 3, 1, -1]);

/** Symbols of literal lengths, match lengths, distances and literals. */
const SYMBOLS = 20 + 20 + 64 + 256;

/**
 * The symbols' frequencies, which end a block's header.
 *
 * @param {Uint8Array} bytes
 * @returns {number[]}
 * @throws {Damaged} they end too early or too late
 */
export function frequenciesOf(bytes) {
    let position = 0;
    const frequencies = Array.from({ length: bytes.length && SYMBOLS }, () => {
        const low = bitsAt(bytes, position, 5);
        const bits = FREQUENCY_BITS[low % 16];
        const own = bitsAt(bytes, position + 4, bits - 4);
        position += bits;
        return bits === 8 ? 8 + own : bits === 14 ? 24 + own : FREQUENCIES[low];
    });
    if (8 * bytes.length - position < 0 || 8 * bytes.length - position >= 8) {
        throw new Damaged("a table of frequencies of another length");
    }
    return frequencies;
}

/** Bits that are read from the end towards the start. */
export class BitsFromEnd {
    /**
     * @param {Uint8Array} bytes
     * @param {number} unused bits at the end
     */
    constructor(bytes, unused) {
        this.bytes = bytes;
        this.position = 8 * bytes.length - unused;
    }

    /** @type {(count: number) => number} */
    take(count) {
        this.position -= count;
        if (this.position < 0) {
            throw new Damaged("coded symbols end too early");
        }
        return bitsAt(this.bytes, this.position, count);
    }
}

/**
 * A decoder of symbols that stand for values: `next(bits)` gives the next value and changes `state`.
 *
 * @param {number} states a power of two
 * @param {number[]} frequencies of the symbols, which sum to at most `states`
 * @param {number[]} extras of each symbol the number of bits that follow it
 * @param {number[]} bases of each symbol the value that these bits are added to
 * @param {number} state the first one
 * @returns {{state: number, next: (bits: BitsFromEnd) => number}}
 * @throws {Damaged} the frequencies or the state are too large
 */
export function decoderOf(states, frequencies, extras, bases, state) {
    const table = [];
    frequencies.forEach((frequency, symbol) => {
        // A symbol's states take `most` bits to the next state, or one less for those beyond the first `longer` ones.
        const most = Math.clz32(frequency) - Math.clz32(states);
        const longer = ((2 * states) >> most) - frequency;
        for (let i = 0; i < frequency && table.length < states; i++) {
            const isLong = i < longer;
            const bits = isLong ? most : most - 1;
            const first = isLong ? ((frequency + i) << bits) - states : (i - longer) << bits;
            table.push({ bits, first, extra: extras[symbol], base: bases[symbol] });
        }
    });
    return {
        state,
        next(source) {
            const entry = table[this.state];
            if (!entry) {
                throw new Damaged("a state that no symbol has");
            }
            this.state = entry.first + source.take(entry.bits);
            return entry.base + source.take(entry.extra);
        },
    };
}
