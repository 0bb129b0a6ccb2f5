/**
 * The probabilities of the range coder of `.pgs`, and what is expected of a number; see `formats/range_coder.py`.
 *
 * @module
 */

export const LONGEST = 26;
export const SIGN = 26;
export const BITS = 28;
export const TREES = 12;
const SLOTS = 112;
const CERTAIN = 1 << 16;
const LEAST = 32;
const SETTLED = 255;
const ACTIVITIES = 6;
const RATES = Int32Array.from({ length: SETTLED + 1 }, (_, n) => Math.floor((1 << 14) / (n + 1.5)));

/** Probabilities of the binary decisions in each context, which adapt. */
export class Models {
    /** @param {number} contexts */
    constructor(contexts) {
        this.zeros = new Int32Array(contexts * ACTIVITIES * SLOTS).fill(CERTAIN / 2);
        this.counts = new Uint8Array(this.zeros.length);
    }

    /** New ones for a column. @type {(contexts: ArrayLike<number>) => Models} */
    static for(contexts) {
        let most = 0;
        for (let i = 0; i < contexts.length; i++) {
            most = Math.max(most, contexts[i]);
        }
        return new Models(most + 1);
    }

    /** Adapt the probability of a decision that was made. @type {(slot: number, bit: 0 | 1) => void} */
    adapt(slot, bit) {
        const zero = this.zeros[slot];
        const count = this.counts[slot];
        const moved = zero + ((((bit ? 0 : CERTAIN) - zero) * RATES[count]) >> 14);
        this.zeros[slot] = Math.min(Math.max(moved, LEAST), CERTAIN - LEAST);
        if (count < SETTLED) {
            this.counts[slot] = count + 1;
        }
    }
}

/**
 * The mean of a row's two neighbours, which is expected there; 0 if it has none.
 *
 * @param {Int32Array} values of the rows before
 * @param {Int32Array | null} neighbours two indices per row
 * @param {number} row
 * @returns {number}
 */
export function expectedAt(values, neighbours, row) {
    if (!neighbours || neighbours[2 * row] < 0) {
        return 0;
    }
    return (values[neighbours[2 * row]] + values[neighbours[2 * row + 1]]) >> 1;
}

/**
 * The first slot of a row's model: of its context and of the distance between its neighbours.
 *
 * @param {number} context
 * @param {Int32Array} values of the rows before
 * @param {Int32Array | null} neighbours two indices per row
 * @param {number} row
 * @returns {number}
 */
export function modelAt(context, values, neighbours, row) {
    let activity = 0;
    if (neighbours && neighbours[2 * row] >= 0) {
        const apart = Math.abs(values[neighbours[2 * row]] - values[neighbours[2 * row + 1]]);
        activity = Math.min(32 - Math.clz32(apart), ACTIVITIES - 1);
    }
    return (context * ACTIVITIES + activity) * SLOTS;
}
