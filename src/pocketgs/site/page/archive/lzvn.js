/**
 * Unpacking LZVN, which LZFSE uses for short content: bytes of operations, each with literals that follow it and a
 * match (lzvn_decode_base.c of Apple's reference implementation).
 *
 * @module
 */

import { Damaged } from "./history.js";

const END = 0x06;
const NOTHING = [0x0e, 0x16];

/** An operation: its size in bytes, its numbers of literals and repeated bytes, and the match's distance if given. */
const operation = (size, literals, repeats, distance = null) => ({ size, literals, repeats, distance });

/**
 * @param {Uint8Array} bytes of the block
 * @param {import("./history.js").History} history
 * @throws {Damaged}
 */
export function unpackLzvn(bytes, history) {
    let [at, last] = [0, 0];
    while (bytes[at] !== END) {
        if (at >= bytes.length) {
            throw new Damaged("a block without an end");
        }
        const { size, literals, repeats, distance } = operationOf(bytes[at], bytes[at + 1] ?? 0, bytes[at + 2] ?? 0);
        last = distance ?? last;
        history.append(bytes, at + size, literals);
        history.repeat(last, repeats);
        at += size + literals;
    }
}

/** The operation that these bytes state. L and M are the bits of literals and matches, D those of distances. */
function operationOf(code, second, third) {
    if (code >= 0xf0) {
        // 1111MMMM, or 11110000 MMMMMMMM
        return code > 0xf0 ? operation(1, 0, code & 15) : operation(2, 0, 16 + second);
    }
    if (code >= 0xe0) {
        // 1110LLLL, or 11100000 LLLLLLLL
        return code > 0xe0 ? operation(1, code & 15, 0) : operation(2, 16 + second, 0);
    }
    if (code >= 0xa0 && code < 0xc0) {
        // 101LLMMM DDDDDDMM DDDDDDDD
        return operation(3, (code >> 3) & 3, 3 + 4 * (code & 7) + (second & 3), (second >> 2) + 64 * third);
    }
    if (NOTHING.includes(code)) {
        return operation(1, 0, 0);
    }
    if ((code >= 0x70 && code < 0x80) || code >= 0xd0) {
        throw new Damaged(`an unknown operation, ${code}`);
    }
    // LLMMMDDD DDDDDDDD; with 111 the distance takes two bytes, with 110 it is the last one.
    const [literals, repeats, high] = [code >> 6, 3 + ((code >> 3) & 7), code & 7];
    if (high === 7) {
        return operation(3, literals, repeats, second + 256 * third);
    }
    if (high === 6 && code < 0x40) {
        throw new Damaged(`an unknown operation, ${code}`);
    }
    return high === 6 ? operation(1, literals, repeats) : operation(2, literals, repeats, 256 * high + second);
}
