/**
 * Morton order; the twin of `scene/morton.py`: neighbours in space become neighbours in memory, in clusters that most
 * views can skip.
 *
 * @module
 */

import { quantileOf } from "../numbers/quantiles.js";

/**
 * @param {Float64Array} positions (N, 3)
 * @param {number} bits per coordinate
 * @returns {Uint32Array} indices that sort the points along the curve; equal ones keep their order
 */
export function mortonOrder(positions, bits) {
    const count = positions.length / 3;
    const bounds = [0, 1, 2].map((axis) => {
        const sorted = Float64Array.from({ length: count }, (_, i) => positions[3 * i + axis]).sort();
        return [quantileOf(sorted, 0.01), quantileOf(sorted, 0.99)];
    });
    // A few outliers must not use up the bits of all others.
    const extent = Math.max(...bounds.map(([low, high]) => high - low), 1.1754944e-38);
    const cells = bounds.map(([low], axis) =>
        Uint32Array.from({ length: count }, (_, i) => {
            const share = (positions[3 * i + axis] - (low - 0.5 * extent)) / (2 * extent);
            return Math.min(Math.max(share, 0), 1) * (2 ** bits - 1);
        }),
    );
    const compare = (a, b) => {
        // The coordinate that differs in the highest bit decides (Chan 2002); among equals the last one.
        let [decisive, highest] = [2, 0];
        for (const axis of [2, 1, 0]) {
            const difference = cells[axis][a] ^ cells[axis][b];
            if (highest < difference && highest < (highest ^ difference)) {
                [decisive, highest] = [axis, difference];
            }
        }
        return cells[decisive][a] - cells[decisive][b];
    };
    return Uint32Array.from(Array.from({ length: count }, (_, i) => i).sort(compare));
}
