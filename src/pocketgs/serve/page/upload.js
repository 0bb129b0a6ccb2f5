/**
 * Sending files in pieces. What was interrupted goes on by itself; after the page was closed, it goes on when the same
 * files are chosen again.
 *
 * @module
 */

import { ask, put, RefusedError } from "./server.js";

const PIECE_BYTES = 1 << 21;
/** How much is sent again where an upload goes on: the server compares it, and so knows that it is the same file. */
const OVERLAP_BYTES = 1 << 16;
const SECONDS_TO_RETRY = [1, 2, 4, 8];

/** The upload of one capture. */
export class Upload {
    #id;
    #pairs;
    #cancelled = new AbortController();

    /**
     * @param {string} id of the capture
     * @param {[Object, File][]} pairs from `matched`
     */
    constructor(id, pairs) {
        this.#id = id;
        this.#pairs = pairs;
    }

    /** Send everything, unless it is cancelled. @throws {Error} the server takes no more of it, or a file is gone */
    async send() {
        try {
            for (const [stated, file] of this.#pairs) {
                await this.#sendFile(stated, file);
            }
        } catch (error) {
            if (this.#cancelled.signal.aborted) {
                return;
            }
            if (!(error instanceof RefusedError && error.status === 404)) {
                throw error;
            }
            await ask(`captures/${this.#id}/files.json`); // it is complete; or was deleted, which this says
        }
    }

    cancel() {
        this.#cancelled.abort();
    }

    async #sendFile({ number, received }, file) {
        let at = received < file.size ? Math.max(0, received - OVERLAP_BYTES) : file.size;
        for (let failures = 0; at < file.size; ) {
            // Read before it is sent: to `fetch`, a file that is gone is the same as a broken connection.
            const piece = await contentOf(file, at);
            try {
                const path = `captures/${this.#id}/files/${number}?offset=${at}`;
                at = (await put(path, piece, this.#cancelled.signal)).received;
                failures = 0;
            } catch (error) {
                if (this.#cancelled.signal.aborted || isFinal(error)) {
                    throw error;
                }
                at = error.facts?.received ?? at;
                await seconds(SECONDS_TO_RETRY[Math.min(failures++, SECONDS_TO_RETRY.length - 1)]);
            }
        }
    }
}

/** @type {(file: File, at: number) => Promise<ArrayBuffer>} */
async function contentOf(file, at) {
    try {
        return await file.slice(at, at + PIECE_BYTES).arrayBuffer();
    } catch {
        throw new Error(`${file.name} cannot be read any more: choose the same files again`);
    }
}

/** Whether the server takes nothing more; false if the same, or what it has not received yet, may be sent again. */
function isFinal(error) {
    return error instanceof RefusedError && error.status !== 408 && error.facts.received === undefined;
}

/**
 * The file for each that the server expects, or null if they are not the same.
 *
 * @param {Object[]} stated what the server expects: `number`, `name`, `size`, `received`
 * @param {File[]} files
 * @returns {[Object, File][] | null}
 */
export function matched(stated, files) {
    const left = [...files];
    const pairs = stated.map((one) => {
        const at = left.findIndex((file) => file.name === one.name && file.size === one.size);
        return [one, at < 0 ? null : left.splice(at, 1)[0]];
    });
    return pairs.some(([one, file]) => file === null && one.received < one.size)
        ? null
        : pairs.filter(([, file]) => file !== null);
}

function seconds(count) {
    return new Promise((resolve) => setTimeout(resolve, 1000 * count));
}
