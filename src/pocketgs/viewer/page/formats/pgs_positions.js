/**
 * The positions of a `.pgs`; the twin of `formats/pgs_positions.py`, which documents the tree.
 *
 * @module
 */

import { Models, RangeDecoder } from "./range_decoder.js";

const EXACT = 24;
const COUNTS = EXACT + 33;

/** Which halves of a node hold something. */
const BOTH = 0;
const LOWER = 1;
const UPPER = 2;

/**
 * Decode cells in Morton order.
 *
 * @param {Uint8Array} stream
 * @param {number} count
 * @param {number} bits per coordinate
 * @returns {Int32Array[]} x, y and z of each
 */
export function decodePositions(stream, count, bits) {
    const coder = new RangeDecoder(stream);
    const [splits, stops] = [new Models(3 * COUNTS), new Models(bits + 1)];
    let nodes = newNodes(1);
    nodes.counts[0] = count;
    nodes.isOpen[0] = 1;
    for (let bit = bits - 1; bit >= 0; bit--) {
        stopLone(nodes, coder, stops, bit);
        for (let axis = 0; axis < 3; axis++) {
            nodes = halved(nodes, lowerCounts(nodes, coder, splits), axis, bit);
        }
    }
    return nodes.cells.map((cells) => repeated(cells, nodes.counts, count));
}

function newNodes(length) {
    return {
        length,
        cells: [0, 1, 2].map(() => new Int32Array(length)),
        counts: new Int32Array(length),
        isOpen: new Uint8Array(length),
        outcomes: new Uint8Array(length),
    };
}

function stopLone({ counts, isOpen }, coder, stops, bit) {
    const lone = new Int32Array(counts.length);
    let found = 0;
    for (let i = 0; i < counts.length; i++) {
        if (isOpen[i] && counts[i] === 1) {
            lone[found++] = i;
        }
    }
    const ends = coder.column(new Uint8Array(found).fill(bit), stops);
    ends.forEach((isEnd, i) => (isOpen[lone[i]] = isEnd ? 0 : 1));
}

/** How many of each node's Gaussians lie in the lower half. */
function lowerCounts({ counts, isOpen, outcomes, length }, coder, splits) {
    const contexts = new Int32Array(length);
    let open = 0;
    for (let i = 0; i < length; i++) {
        if (isOpen[i]) {
            const size = counts[i] <= EXACT ? counts[i] : EXACT + 32 - Math.clz32(counts[i]);
            contexts[open++] = size + COUNTS * outcomes[i];
        }
    }
    const found = coder.column(contexts.subarray(0, open), splits);
    const lower = Int32Array.from(counts);
    for (let i = 0, next = 0; i < length; i++) {
        if (isOpen[i]) {
            lower[i] = Math.max(0, Math.min(found[next++], counts[i]));
        }
    }
    return lower;
}

function halved(nodes, lower, axis, bit) {
    let length = 0;
    for (let i = 0; i < nodes.length; i++) {
        length += (lower[i] > 0) + (lower[i] < nodes.counts[i]);
    }
    const halves = newNodes(length);
    const [xs, ys, zs] = nodes.cells;
    const [newXs, newYs, newZs] = halves.cells;
    const halved = halves.cells[axis];
    let next = 0;
    for (let i = 0; i < nodes.length; i++) {
        const upper = nodes.counts[i] - lower[i];
        for (let side = 0; side < 2; side++) {
            const count = side ? upper : lower[i];
            if (count > 0) {
                newXs[next] = xs[i];
                newYs[next] = ys[i];
                newZs[next] = zs[i];
                halved[next] |= side << bit;
                halves.counts[next] = count;
                halves.isOpen[next] = nodes.isOpen[i];
                halves.outcomes[next++] = (side ? lower[i] : upper) > 0 ? BOTH : side ? UPPER : LOWER;
            }
        }
    }
    return halves;
}

function repeated(cells, counts, total) {
    const all = new Int32Array(total);
    let next = 0;
    counts.forEach((count, i) => {
        all.fill(cells[i], next, next + count);
        next += count;
    });
    return all;
}
