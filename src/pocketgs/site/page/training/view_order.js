/**
 * In which order views are trained on; the twin of `view_of_step` in `training/view_choice.py`.
 *
 * @module
 */

import { Generator } from "../random/generator.js";

/** Every view once per epoch, in an order of the seed and the epoch. */
export class ViewOrder {
    #views;
    #seed;
    #epoch = -1;
    #order;

    /**
     * @param {number} views
     * @param {number} seed
     */
    constructor(views, seed) {
        this.#views = views;
        this.#seed = seed;
    }

    /** The view of a step. @type {(step: number) => number} */
    at(step) {
        const epoch = Math.floor(step / this.#views);
        if (epoch !== this.#epoch) {
            [this.#epoch, this.#order] = [epoch, new Generator(this.#seed, epoch).permutation(this.#views)];
        }
        return this.#order[step % this.#views];
    }
}
