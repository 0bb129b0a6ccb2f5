/**
 * Random numbers as `numpy.random.default_rng` draws them.
 *
 * @module
 */

import { Pcg64 } from "./pcg64.js";

/** Draws numbers. The same seeds and calls give the same numbers as in NumPy. */
export class Generator {
    #bits;

    /** @param {...number} seeds whole numbers from 0 */
    constructor(...seeds) {
        this.#bits = new Pcg64(seeds);
    }

    /**
     * @param {number} end
     * @returns {number} a whole number from 0 to below `end`, which is at most 2^32
     */
    integer(end) {
        if (end <= 1) {
            return 0;
        }
        // Lemire 2019: the upper half of a product, without bias once its lower half is not below the threshold.
        const threshold = (2 ** 32 - end) % end;
        for (;;) {
            const product = BigInt(this.#bits.next32()) * BigInt(end);
            if (Number(product & 0xffff_ffffn) >= threshold) {
                return Number(product >> 32n);
            }
        }
    }

    /** @returns {number} from `low` to below `high` */
    uniform(low, high) {
        return low + (high - low) * (Number(this.#bits.next64() >> 11n) / 2 ** 53);
    }

    /**
     * @param {number} count
     * @returns {Uint32Array} the numbers below `count` in random order
     */
    permutation(count) {
        const order = Uint32Array.from({ length: count }, (_, i) => i);
        for (let i = count - 1; i > 0; i--) {
            const j = this.#upTo(i);
            [order[i], order[j]] = [order[j], order[i]];
        }
        return order;
    }

    /** A whole number up to and with `last`: of as many bits as it has, drawn until it is small enough. */
    #upTo(last) {
        const unused = Math.clz32(last);
        for (;;) {
            const value = (this.#bits.next32() << unused) >>> unused;
            if (value <= last) {
                return value;
            }
        }
    }
}
