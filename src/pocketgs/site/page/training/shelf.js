/**
 * Which photograph lies where on the GPU; the twin of `Shelf` in `splat/webgpu/photographs.py`. As many as there is
 * room for have places of their own. The others share one, and are written there before the step that needs them.
 *
 * @module
 */

export const PIXEL_BYTES = 4;

/** Places, counted in pixels. */
export class Shelf {
    #own = [];
    #sharedPlace;

    /**
     * @param {number[]} sizes pixels of every photograph
     * @param {number} room pixels that the buffer may hold
     * @throws {Error} it does not hold even one
     */
    constructor(sizes, room) {
        const total = sizes.reduce((sum, size) => sum + size, 0);
        const largest = Math.max(...sizes);
        if (largest > room) {
            throw new Error(`the GPU's memory does not hold a photograph of ${largest} pixels: choose a smaller size`);
        }
        const shared = total <= room ? 0 : largest;
        let place = 0;
        for (const size of sizes) {
            const fits = place + size + shared <= room;
            this.#own.push(fits ? place : null);
            place += fits ? size : 0;
        }
        this.#sharedPlace = place;
        this.pixels = place + shared;
    }

    /** Where a photograph begins. @type {(view: number) => number} */
    place(view) {
        return this.#own[view] ?? this.#sharedPlace;
    }

    /** Whether it has a place of its own. @type {(view: number) => boolean} */
    isResident(view) {
        return this.#own[view] !== null;
    }
}
