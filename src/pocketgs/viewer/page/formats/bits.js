/**
 * Bits of packed bytes.
 *
 * @module
 */

/**
 * Bits of little-endian bytes, at most 25 of them; 0 beyond the end.
 *
 * @type {(bytes: Uint8Array, position: number, count: number) => number}
 */
export function bitsAt(bytes, position, count) {
    const at = position >>> 3;
    const word = bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16) | (bytes[at + 3] << 24);
    return (word >>> (position & 7)) & (2 ** count - 1);
}
