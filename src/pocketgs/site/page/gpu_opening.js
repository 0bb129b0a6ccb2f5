/**
 * Opening a GPU, and opening it anew after it was lost.
 *
 * @module
 */

import { TRIES, tried } from "../page/drawing/opening.js";

/**
 * The GPU, open whenever that is possible.
 *
 * @template {{lost: Promise<unknown>}} T
 */
export class GpuOpening {
    #open;
    #onOpen;
    #onFault;
    /** @type {Promise<T> | null} null once it has failed: the next who needs the GPU tries again */
    #opening = null;

    /**
     * Open it at once. A browser without a GPU is told of without a pause.
     *
     * @param {() => Promise<T>} open
     * @param {() => void} onOpen called each time that it is open
     * @param {(error: Error) => void} onFault called when it cannot be opened
     */
    constructor(open, onOpen, onFault) {
        [this.#open, this.#onOpen, this.#onFault] = [open, onOpen, onFault];
        this.#begin(1);
    }

    /** @returns {Promise<T>} */
    get() {
        return this.#opening ?? this.#begin(TRIES);
    }

    #begin(tries) {
        const opening = tried(this.#open, tries);
        this.#opening = opening;
        opening.then(
            ({ lost }) => {
                this.#onOpen();
                lost.then(() => void this.#begin(TRIES));
            },
            (error) => {
                this.#opening = null;
                this.#onFault(error);
            },
        );
        return opening;
    }
}
