/**
 * NumPy's default random bits, so that a run draws the same numbers as in Python: PCG64 (O'Neill 2014, XSL-RR output),
 * seeded as by `numpy.random.SeedSequence`.
 *
 * @module
 */

const WORD = 0xffff_ffffn;
const DOUBLE_WORD = (1n << 64n) - 1n;
const STATE = (1n << 128n) - 1n;
const MULTIPLIER = 0x2360_ed05_1fc6_5da4_4385_df64_9fcc_f645n;

const POOL_WORDS = 4;

/** A stream of random bits. */
export class Pcg64 {
    #state = 0n;
    #increment;
    #kept = null;

    /** @param {number[]} seeds one to four whole numbers below 2^32 */
    constructor(seeds) {
        const [high, low, incrementHigh, incrementLow] = seedWords(seeds);
        this.#increment = ((((incrementHigh << 64n) | incrementLow) << 1n) | 1n) & STATE;
        this.#advance();
        this.#state = (this.#state + ((high << 64n) | low)) & STATE;
        this.#advance();
    }

    /** @returns {bigint} 64 random bits */
    next64() {
        this.#advance();
        const turn = this.#state >> 122n;
        const mixed = (this.#state >> 64n) ^ (this.#state & DOUBLE_WORD);
        return ((mixed >> turn) | (mixed << (64n - turn))) & DOUBLE_WORD;
    }

    /** @returns {number} 32 random bits: the lower half of 64, and at the next call the upper half */
    next32() {
        if (this.#kept !== null) {
            const kept = this.#kept;
            this.#kept = null;
            return kept;
        }
        const next = this.next64();
        this.#kept = Number(next >> 32n);
        return Number(next & WORD);
    }

    #advance() {
        this.#state = (this.#state * MULTIPLIER + this.#increment) & STATE;
    }
}

/** Four words of 64 bits from `SeedSequence(seeds).generate_state`. */
function seedWords(seeds) {
    const pool = mixedPool(seeds);
    let constant = 0x8b51_f9dd;
    const halves = Array.from({ length: 2 * POOL_WORDS }, (_, i) => {
        const value = pool[i % POOL_WORDS] ^ constant;
        constant = Math.imul(constant, 0x58f3_8ded);
        return shifted(Math.imul(value, constant));
    });
    return [0, 2, 4, 6].map((i) => BigInt(halves[i]) | (BigInt(halves[i + 1]) << 32n));
}

function mixedPool(seeds) {
    let constant = 0x43b0_d7e5;
    const hashed = (value) => {
        const mixed = value ^ constant;
        constant = Math.imul(constant, 0x931e_8875);
        return shifted(Math.imul(mixed, constant));
    };
    const pool = Array.from({ length: POOL_WORDS }, (_, i) => hashed(seeds[i] ?? 0));
    for (let source = 0; source < POOL_WORDS; source++) {
        for (let target = 0; target < POOL_WORDS; target++) {
            if (source !== target) {
                const both = Math.imul(0xca01_f9dd, pool[target]) - Math.imul(0x4973_f715, hashed(pool[source]));
                pool[target] = shifted(both);
            }
        }
    }
    return pool;
}

/** The lower 32 bits, mixed with their upper half. */
function shifted(value) {
    return (value ^ (value >>> 16)) >>> 0;
}
