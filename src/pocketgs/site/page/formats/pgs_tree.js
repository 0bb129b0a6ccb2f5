/**
 * Writing the positions of a `.pgs`; the twin of `formats/pgs_positions.py`, which documents the tree.
 *
 * @module
 */

import { contextsOf, halved, loneOf, openOf, rootOf, treeModels } from "../../page/formats/pgs_positions.js";
import { RangeEncoder } from "./range_encoder.js";

const HALF = 12;

/**
 * Indices that put cells into the order of the tree; equal ones keep theirs.
 *
 * @param {Int32Array[]} cells x, y and z, not negative and below 2^24
 * @returns {Uint32Array}
 */
export function inTreeOrder(cells) {
    const [low, high] = [0, HALF].map((first) => interleaved(cells, first));
    const order = Array.from(low, (_, i) => i);
    return Uint32Array.from(order.sort((a, b) => high[a] - high[b] || low[a] - low[b]));
}

/** Of each cell, half of its bits, those of x, y and z in turn. */
function interleaved([xs, ys, zs], first) {
    const words = new Float64Array(xs.length);
    for (let i = 0; i < xs.length; i++) {
        for (let bit = first + HALF - 1; bit >= first; bit--) {
            const three = (((xs[i] >> bit) & 1) << 2) | (((ys[i] >> bit) & 1) << 1) | ((zs[i] >> bit) & 1);
            words[i] = 8 * words[i] + three;
        }
    }
    return words;
}

/**
 * Encode cells in the order of the tree.
 *
 * @param {Int32Array[]} cells x, y and z
 * @param {number} bits per coordinate
 * @returns {Uint8Array}
 */
export function encodePositions(cells, bits) {
    const coder = new RangeEncoder();
    const { splits, stops } = treeModels(bits);
    let nodes = rootOf(cells[0].length);
    for (let bit = bits - 1; bit >= 0; bit--) {
        stopLone(nodes, cells, coder, stops, bit);
        for (let axis = 0; axis < 3; axis++) {
            const lower = lowerCounts(nodes, cells[axis], bit);
            const open = openOf(nodes);
            coder.column(open.map((node) => lower[node]), contextsOf(nodes, open), splits);
            nodes = halved(nodes, lower, axis, bit);
        }
    }
    return coder.finish();
}

/** A lone Gaussian states whether the rest of its bits is zero. */
function stopLone(nodes, [xs, ys, zs], coder, stops, bit) {
    const [lone, starts, rest] = [loneOf(nodes), startsOf(nodes), (2 << bit) - 1];
    const ends = lone.map((node) => {
        const cell = starts[node];
        return (xs[cell] | ys[cell] | zs[cell]) & rest ? 0 : 1;
    });
    coder.column(ends, new Uint8Array(lone.length).fill(bit), stops);
    lone.forEach((node, i) => (nodes.isOpen[node] = ends[i] ? 0 : 1));
}

/** The first cell of each node: together they hold all, in order. */
function startsOf({ counts }) {
    let start = 0;
    return counts.map((count) => (start += count) - count);
}

/** How many of each node's Gaussians lie in the lower half; all of a node that is not divided any more. */
function lowerCounts({ counts, isOpen }, column, bit) {
    let cell = 0;
    return counts.map((count, node) => {
        let lower = 0;
        for (const end = cell + count; cell < end; cell++) {
            lower += isOpen[node] && (column[cell] >> bit) & 1 ? 0 : 1;
        }
        return lower;
    });
}
