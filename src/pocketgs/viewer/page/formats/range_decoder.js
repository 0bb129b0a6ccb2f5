/**
 * The adaptive binary range coder of `.pgs`; the twin of `formats/range_coder.py`, which documents it.
 *
 * @module
 */

import { BITS, expectedAt, LONGEST, modelAt, Models, SIGN, TREES } from "./range_models.js";

/** The largest magnitude of a number, and the largest count of Gaussians. */
export const MAX_NUMBER = 1 << 24;

/** Decodes columns of numbers; zeros follow the end of the stream. */
export class RangeDecoder {
    #bytes;
    #place = 4;
    #range = 0xffffffff;
    #code = 0;

    /** @param {Uint8Array} bytes */
    constructor(bytes) {
        this.#bytes = bytes;
        for (let i = 0; i < 4; i++) {
            this.#code = this.#code * 256 + (bytes[i] ?? 0);
        }
    }

    /**
     * Decode the next column.
     *
     * @param {ArrayLike<number>} contexts of each number
     * @param {Models} [models] of the contexts; by default new ones
     * @param {Int32Array} [neighbours] two indices of earlier rows per row, of which the mean is expected
     * @returns {Int32Array}
     * @throws {Error} a number exceeds all bounds
     */
    column(contexts, models = Models.for(contexts), neighbours = null) {
        const values = new Int32Array(contexts.length);
        for (let i = 0; i < values.length; i++) {
            const model = modelAt(contexts[i], values, neighbours, i);
            const value = expectedAt(values, neighbours, i) + this.#number(models, model);
            if (Math.abs(value) > MAX_NUMBER) {
                throw new Error("the .pgs is broken: a number exceeds all bounds");
            }
            values[i] = value;
        }
        return values;
    }

    /** A number: the length of its magnitude in bits, its sign, and the bits after the leading one. */
    #number(models, context) {
        let length = 0;
        while (length < LONGEST && this.#bit(models, context + length)) {
            length++;
        }
        if (length === 0) {
            return 0;
        }
        const isNegative = this.#bit(models, context + SIGN);
        const leading = context + BITS + 7 * (length - 2) - 1;
        let size = 1;
        let node = 1;
        for (let left = length - 1; left > 0; left--) {
            let bit;
            if (node < 8 && length <= TREES + 1) {
                bit = this.#bit(models, leading + node);
                node = 2 * node + bit;
            } else {
                bit = this.#take(this.#range >>> 1);
            }
            size = 2 * size + bit;
        }
        return isNegative ? -size : size;
    }

    #bit(models, slot) {
        const bit = this.#take((this.#range >>> 16) * models.zeros[slot]);
        models.adapt(slot, bit);
        return bit;
    }

    #take(bound) {
        const bit = this.#code >= bound ? 1 : 0;
        if (bit) {
            this.#code -= bound;
            this.#range -= bound;
        } else {
            this.#range = bound;
        }
        while (this.#range < 0x1000000) {
            const byte = this.#place < this.#bytes.length ? this.#bytes[this.#place] : 0;
            this.#place++;
            this.#range = (this.#range << 8) >>> 0;
            this.#code = ((this.#code << 8) | byte) >>> 0;
        }
        return bit;
    }
}
