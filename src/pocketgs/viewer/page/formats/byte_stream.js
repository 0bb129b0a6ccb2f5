/**
 * Reading pieces of given sizes from a stream.
 *
 * @module
 */

/** Reads a stream piece by piece; memory is allocated only for bytes that have arrived. */
export class ByteStream {
    #reader;
    #chunks = [];
    #waiting = 0;
    #received = 0;
    #onProgress;

    /**
     * @param {ReadableStream<Uint8Array>} stream
     * @param {(received: number) => void} onProgress called with the number of bytes received
     */
    constructor(stream, onProgress = () => {}) {
        this.#reader = stream.getReader();
        this.#onProgress = onProgress;
    }

    /**
     * Read the next bytes, fewer only at the end of the stream.
     *
     * @param {number} count
     * @returns {Promise<Uint8Array>}
     */
    async takeUpTo(count) {
        await this.#receive(count);
        const size = Math.min(count, this.#waiting);
        const piece = new Uint8Array(size);
        for (let filled = 0; filled < size; ) {
            const chunk = this.#chunks.shift();
            const part = chunk.subarray(0, size - filled);
            piece.set(part, filled);
            filled += part.length;
            if (part.length < chunk.length) {
                this.#chunks.unshift(chunk.subarray(part.length));
            }
        }
        this.#waiting -= size;
        return piece;
    }

    /**
     * Read the next bytes.
     *
     * @param {number} count
     * @returns {Promise<Uint8Array>}
     * @throws {Error} the stream ends early
     */
    async take(count) {
        const piece = await this.takeUpTo(count);
        if (piece.length < count) {
            throw new Error(`the file is cut short: found ${piece.length} bytes, expected ${count} more`);
        }
        return piece;
    }

    /**
     * Put back the last bytes read.
     *
     * @param {Uint8Array} piece
     */
    putBack(piece) {
        this.#chunks.unshift(piece);
        this.#waiting += piece.length;
    }

    /**
     * The rest of the stream, decompressed with gzip on demand.
     *
     * @returns {ByteStream}
     */
    gunzipped() {
        const rest = new ReadableStream({
            pull: async (controller) => {
                const piece = await this.takeUpTo(1 << 16);
                return piece.length ? controller.enqueue(piece) : controller.close();
            },
        });
        return new ByteStream(rest.pipeThrough(new DecompressionStream("gzip")));
    }

    async #receive(count) {
        while (this.#waiting < count) {
            const { value, done } = await this.#reader.read();
            if (done) {
                return;
            }
            this.#chunks.push(value);
            this.#waiting += value.length;
            this.#received += value.length;
            this.#onProgress(this.#received);
        }
    }
}
