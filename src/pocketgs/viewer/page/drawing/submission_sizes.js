/**
 * How much work a submission to the GPU may hold, by what earlier ones took: browsers and drivers take the GPU away
 * from a page whose submission runs for seconds.
 *
 * @module
 */

/** An image is drawn by one submission if it is expected to take at most so many milliseconds. */
const WHOLE = 150;

/** Milliseconds that one submission of several takes, as nearly as it can be chosen. */
const PART = 100;

/** Tiles of the first part ever, and the most by which a part may be larger than the one before. */
const FIRST_TILES = 64;
const GROWTH = 4;

/** Chooses sizes, and is told what they took. */
export class SubmissionSizes {
    /** Number of tiles of the next part. */
    tiles = FIRST_TILES;
    /** Milliseconds of the quickest part, as the least that waiting takes: Firefox looks only every 100 ms. */
    #latency = Infinity;
    /** The last image's. */
    #pixels = 0;
    #took = Infinity;

    /** Whether no image has been drawn. */
    get isUntried() {
        return this.#took === Infinity;
    }

    /**
     * Whether one submission may draw a whole image. Nothing is known before the first image.
     *
     * @param {number} pixels of the image
     */
    mayDrawWhole(pixels) {
        return this.#took * Math.max(1, pixels / this.#pixels) <= WHOLE;
    }

    /**
     * @param {number} pixels of an image
     * @param {number} took milliseconds, all of its submissions together
     * @param {number} waits how often the host waited for the GPU
     */
    imageTook(pixels, took, waits) {
        [this.#pixels, this.#took] = [pixels, took - waits * this.#latency];
    }

    /**
     * @param {number} tiles of a part
     * @param {number} took milliseconds
     */
    partTook(tiles, took) {
        this.#latency = Math.min(this.#latency, took);
        // The last part of an image is smaller than it might be.
        if (tiles === this.tiles) {
            const share = PART / Math.max(took - this.#latency, 1e-3);
            this.tiles = Math.max(1, Math.round(tiles * Math.min(GROWTH, share)));
        }
    }
}
