/**
 * Taking bytes from a stream in pieces of wanted sizes.
 *
 * @module
 */

/** Reads a stream piece by piece; nothing is allocated for bytes that have not come. */
export class ByteStream {
    #reader;
    #chunks = [];
    #waiting = 0;
    #received = 0;
    #onProgress;

    /**
     * @param {ReadableStream<Uint8Array>} stream
     * @param {(received: number) => void} onProgress told how many bytes have come
     */
    constructor(stream, onProgress = () => {}) {
        this.#reader = stream.getReader();
        this.#onProgress = onProgress;
    }

    /**
     * The next bytes, fewer only where the stream ends.
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
     * The next bytes.
     *
     * @param {number} count
     * @returns {Promise<Uint8Array>}
     * @throws {Error} the stream ends before
     */
    async take(count) {
        const piece = await this.takeUpTo(count);
        if (piece.length < count) {
            throw new Error(`the file is cut short: found ${piece.length} bytes, expected ${count} more`);
        }
        return piece;
    }

    /**
     * Put bytes back that were taken last.
     *
     * @param {Uint8Array} piece
     */
    putBack(piece) {
        this.#chunks.unshift(piece);
        this.#waiting += piece.length;
    }

    /**
     * All that is left, unpacked from gzip as it is asked for.
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
