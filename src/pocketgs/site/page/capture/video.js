/**
 * Frames of a video, decoded by the browser in their order.
 *
 * @module
 */

import { readTrack } from "./mp4.js";
import { drawn } from "./pixels.js";

/** Frames that may wait for the decoder. */
const MOST_WAITING = 8;

/** A video whose tables are read. */
export class Video {
    #path;
    #bytes;
    #track;

    /**
     * @param {string} path for messages
     * @param {Uint8Array} bytes
     * @throws {Error} it is no MP4 file with a video, or a broken one
     */
    constructor(path, bytes) {
        [this.#path, this.#bytes, this.#track] = [path, bytes, readTrack(bytes, path)];
        [this.width, this.height, this.count] = [this.#track.width, this.#track.height, this.#track.shown.size];
    }

    /** @type {(file: import("../archive/tree.js").StoredFile) => Promise<Video>} */
    static async of(file) {
        return new Video(file.path, await file.bytes());
    }

    /**
     * Decode frames, one at a time.
     *
     * @param {number[]} wanted numbers of frames in the order in which they are shown, ascending
     * @yields {import("./pixels.js").Pixels} each, as stored: the rotation that the file states is not applied
     * @throws {Error} the browser cannot decode the video, or it ends before a frame that is wanted
     */
    async *frames(wanted) {
        const { codec, description, samples, shown } = this.#track;
        const config = { codec, description };
        const { supported } = (await self.VideoDecoder?.isConfigSupported(config).catch(() => null)) ?? {};
        if (!supported) {
            const expected = "expected one that can, or the frames as photographs";
            throw new Error(`${this.#path}: this browser cannot decode a video of the codec ${codec}, ${expected}`);
        }
        const left = new Set(wanted);
        const decoding = new Decoding(config, ({ timestamp }) => left.has(shown.get(timestamp)));
        try {
            for (const { start, size, time, isKey } of samples) {
                const data = this.#bytes.subarray(start, start + size);
                const sample = { type: isKey ? "key" : "delta", timestamp: time, data };
                yield* this.#taken(decoding.add(sample), left);
                if (!left.size) {
                    return;
                }
            }
            yield* this.#taken(decoding.rest(), left);
        } catch (error) {
            throw error instanceof DOMException ? this.#broken(error.message) : error;
        } finally {
            decoding.close();
        }
        if (left.size) {
            throw this.#broken(`the frame ${Math.min(...left)} is missing`);
        }
    }

    async *#taken(frames, left) {
        for await (const frame of frames) {
            const { width, height } = frame.visibleRect;
            const pixels = drawn(frame, width, height);
            left.delete(this.#track.shown.get(frame.timestamp));
            frame.close();
            yield pixels;
        }
    }

    #broken(found) {
        return new Error(`${this.#path}: cannot be decoded (${found}), expected a whole video`);
    }
}

/** A decoder whose frames are taken as they come: it may give no more of them until those are closed. */
class Decoding {
    #decoder;
    #found = [];
    #error = null;
    #wake = () => {};

    constructor(config, isWanted) {
        this.#decoder = new VideoDecoder({
            output: (frame) => {
                isWanted(frame) ? this.#found.push(frame) : frame.close();
                this.#wake();
            },
            error: (error) => {
                this.#error = error;
                this.#wake();
            },
        });
        this.#decoder.configure(config);
        this.#decoder.addEventListener("dequeue", () => this.#wake());
    }

    /** Decode one more sample. @yields {VideoFrame} those that have come */
    async *add(sample) {
        yield* this.#until(() => this.#decoder.decodeQueueSize < MOST_WAITING);
        this.#decoder.decode(new EncodedVideoChunk(sample));
    }

    /** @yields {VideoFrame} those that are left */
    async *rest() {
        let isFlushed = false;
        const flushing = this.#decoder.flush().then(() => (isFlushed = true));
        flushing.catch((error) => (this.#error ??= error)).then(() => this.#wake());
        yield* this.#until(() => isFlushed);
    }

    close() {
        this.#found.forEach((frame) => frame.close());
        if (this.#decoder.state !== "closed") {
            this.#decoder.close();
        }
    }

    /** @yields {VideoFrame} those that come until something is so */
    async *#until(isSo) {
        for (;;) {
            if (this.#error) {
                throw this.#error;
            } else if (this.#found.length) {
                yield this.#found.shift();
            } else if (isSo()) {
                return;
            } else {
                await new Promise((resolve) => (this.#wake = resolve));
            }
        }
    }
}
