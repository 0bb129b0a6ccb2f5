/**
 * The checksum of `.pgs` and zip files (ISO 3309).
 *
 * @module
 */

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
    for (let bit = 0; bit < 8; bit++) {
        byte = byte & 1 ? (byte >>> 1) ^ 0xedb8_8320 : byte >>> 1;
    }
    return byte;
});

/**
 * @param {Uint8Array} bytes
 * @returns {number}
 */
export function crc32(bytes) {
    let sum = 0xffff_ffff;
    for (let i = 0; i < bytes.length; i++) {
        sum = TABLE[(sum ^ bytes[i]) & 0xff] ^ (sum >>> 8);
    }
    return (sum ^ 0xffff_ffff) >>> 0;
}
