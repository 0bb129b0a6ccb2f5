/**
 * The adaptive binary range coder of `.pgs`; the twin of `formats/range_coder.py`, which documents it.
 *
 * @module
 */

const SLOTS = 112;
const LONGEST = 26;
const SIGN = 26;
const BITS = 28;
const TREES = 12;
const CERTAIN = 1 << 16;
const LEAST = 32;
const SETTLED = 255;
const ACTIVITIES = 6;
const RATES = Int32Array.from({ length: SETTLED + 1 }, (_, n) => Math.floor((1 << 14) / (n + 1.5)));

/** The largest magnitude of a number, and the largest count of Gaussians. */
export const MAX_NUMBER = 1 << 24;

/** Probabilities of the binary decisions in each context, which adapt. */
export class Models {
    /** @param {number} contexts */
    constructor(contexts) {
        this.zeros = new Int32Array(contexts * ACTIVITIES * SLOTS).fill(CERTAIN / 2);
        this.counts = new Uint8Array(this.zeros.length);
    }
}

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
    column(contexts, models = modelsFor(contexts), neighbours = null) {
        const values = new Int32Array(contexts.length);
        for (let i = 0; i < values.length; i++) {
            let expected = 0;
            let activity = 0;
            if (neighbours && neighbours[2 * i] >= 0) {
                const first = values[neighbours[2 * i]];
                const second = values[neighbours[2 * i + 1]];
                expected = (first + second) >> 1;
                activity = Math.min(32 - Math.clz32(Math.abs(first - second)), ACTIVITIES - 1);
            }
            const value = expected + this.#number(models, (contexts[i] * ACTIVITIES + activity) * SLOTS);
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
        const zero = models.zeros[slot];
        const count = models.counts[slot];
        const bit = this.#take((this.#range >>> 16) * zero);
        const moved = zero + ((((bit ? 0 : CERTAIN) - zero) * RATES[count]) >> 14);
        models.zeros[slot] = Math.min(Math.max(moved, LEAST), CERTAIN - LEAST);
        if (count < SETTLED) {
            models.counts[slot] = count + 1;
        }
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

function modelsFor(contexts) {
    let most = 0;
    for (let i = 0; i < contexts.length; i++) {
        most = Math.max(most, contexts[i]);
    }
    return new Models(most + 1);
}
