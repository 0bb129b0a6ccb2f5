/**
 * What a decoder of the Lempel-Ziv family has unpacked so far, bounded by the size that it must come to.
 *
 * @module
 */

/** A compressed file that is not as its format says. */
export class Damaged extends Error {}

/** Bytes that literals and matches fill from the start. */
export class History {
    /** @param {number} size bytes of the whole content */
    constructor(size) {
        this.bytes = new Uint8Array(size);
        this.filled = 0;
    }

    /**
     * Append bytes of the file.
     *
     * @param {Uint8Array} source
     * @param {number} begin
     * @param {number} count
     * @throws {Damaged} there are fewer, or there is no room for them
     */
    append(source, begin, count) {
        if (begin + count > source.length || count > this.bytes.length - this.filled) {
            throw new Damaged("literals end too early");
        }
        this.bytes.set(source.subarray(begin, begin + count), this.filled);
        this.filled += count;
    }

    /**
     * Append what stands `distance` bytes before; the copy may run into itself.
     *
     * @param {number} distance
     * @param {number} count
     * @throws {Damaged} the distance leads before the start, or there is no room
     */
    repeat(distance, count) {
        if (count && (distance < 1 || distance > this.filled || count > this.bytes.length - this.filled)) {
            throw new Damaged("a match leads outside the content");
        }
        for (const end = this.filled + count; this.filled < end; this.filled++) {
            this.bytes[this.filled] = this.bytes[this.filled - distance];
        }
    }
}
