/**
 * Writing with the adaptive binary range coder of `.pgs`; the twin of `formats/range_coder.py`, which documents it.
 *
 * @module
 */

import { BITS, expectedAt, LONGEST, modelAt, Models, SIGN, TREES } from "../../page/formats/range_models.js";

const FIRST_ROOM = 1 << 16;

/** Encodes columns of numbers into one stream of bytes. */
export class RangeEncoder {
    #bytes = new Uint8Array(FIRST_ROOM);
    #place = 0;
    #low = 0;
    #range = 0xffffffff;
    #cache = 0;
    /** Bytes of ones after the cached one, which a carry would change. */
    #pending = 0;

    /**
     * Encode the next column.
     *
     * @param {ArrayLike<number>} values whole numbers of a magnitude below 2^26
     * @param {ArrayLike<number>} contexts of each number
     * @param {Models} [models] of the contexts; by default new ones
     * @param {Int32Array} [neighbours] two indices of earlier rows per row, of which the mean is expected
     */
    column(values, contexts, models = Models.for(contexts), neighbours = null) {
        for (let i = 0; i < values.length; i++) {
            const model = modelAt(contexts[i], values, neighbours, i);
            this.#number(values[i] - expectedAt(values, neighbours, i), models, model);
        }
    }

    /** The stream. @returns {Uint8Array} */
    finish() {
        for (let i = 0; i < 5; i++) {
            this.#shiftLow();
        }
        return this.#bytes.slice(1, this.#place);
    }

    /** The length of the magnitude in bits, the sign, and the bits after the leading one. */
    #number(value, models, model) {
        const size = Math.abs(value);
        const length = 32 - Math.clz32(size);
        for (let place = 0; place < length; place++) {
            this.#bit(1, models, model + place);
        }
        if (length < LONGEST) {
            this.#bit(0, models, model + length);
        }
        if (length) {
            this.#bit(value < 0 ? 1 : 0, models, model + SIGN);
        }
        const leading = model + BITS + 7 * (length - 2) - 1;
        let node = 1;
        for (let place = length - 2; place >= 0; place--) {
            const bit = (size >> place) & 1;
            if (node < 8 && length <= TREES + 1) {
                this.#bit(bit, models, leading + node);
                node = 2 * node + bit;
            } else {
                this.#put(this.#range >>> 1, bit);
            }
        }
    }

    #bit(bit, models, slot) {
        this.#put((this.#range >>> 16) * models.zeros[slot], bit);
        models.adapt(slot, bit);
    }

    #put(bound, bit) {
        if (bit) {
            this.#low += bound;
            this.#range -= bound;
        } else {
            this.#range = bound;
        }
        while (this.#range < 0x1000000) {
            this.#range = (this.#range << 8) >>> 0;
            this.#shiftLow();
        }
    }

    /** Move the highest byte of the low end to the stream, once no carry can change it. */
    #shiftLow() {
        if (this.#low < 0xff000000 || this.#low > 0xffffffff) {
            const carry = this.#low > 0xffffffff ? 1 : 0;
            this.#write(this.#cache + carry);
            for (; this.#pending; this.#pending--) {
                this.#write(0xff + carry);
            }
            this.#cache = (this.#low >>> 24) & 0xff;
        } else {
            this.#pending++;
        }
        this.#low = (this.#low << 8) >>> 0;
    }

    #write(byte) {
        if (this.#place === this.#bytes.length) {
            const larger = new Uint8Array(2 * this.#place);
            larger.set(this.#bytes);
            this.#bytes = larger;
        }
        this.#bytes[this.#place++] = byte;
    }
}
