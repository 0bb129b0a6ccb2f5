/**
 * Unpacking to a size that is known beforehand: no more than that is ever kept.
 *
 * @module
 */

/**
 * All of a stream, or null where it is not of the size that was stated.
 *
 * @param {ReadableStream<Uint8Array>} stream
 * @param {number} size bytes
 * @returns {Promise<Uint8Array | null>}
 */
export async function taken(stream, size) {
    const bytes = new Uint8Array(size);
    let filled = 0;
    const reader = stream.getReader();
    for (;;) {
        const { value, done } = await reader.read();
        if (done) {
            return filled === size ? bytes : null;
        }
        if (filled + value.length > size) {
            await reader.cancel();
            return null;
        }
        bytes.set(value, filled);
        filled += value.length;
    }
}

/**
 * The content of a zlib stream, or null where it is damaged or of another size.
 *
 * @param {Uint8Array[]} parts of the stream
 * @param {number} size bytes of the content
 * @returns {Promise<Uint8Array | null>}
 */
export function inflated(parts, size) {
    const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream("deflate"));
    return taken(stream, size).catch(() => null);
}
