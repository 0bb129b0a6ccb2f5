/**
 * The positions of a `.pgs`; the twin of `formats/pgs_positions.py`, which documents the tree.
 *
 * @module
 */

import { RangeDecoder } from "./range_decoder.js";
import { Models } from "./range_models.js";

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
    const { splits, stops } = treeModels(bits);
    let nodes = rootOf(count);
    for (let bit = bits - 1; bit >= 0; bit--) {
        const lone = loneOf(nodes);
        const ends = coder.column(new Uint8Array(lone.length).fill(bit), stops);
        ends.forEach((isEnd, i) => (nodes.isOpen[lone[i]] = isEnd ? 0 : 1));
        for (let axis = 0; axis < 3; axis++) {
            const open = openOf(nodes);
            const found = coder.column(contextsOf(nodes, open), splits);
            const lower = Int32Array.from(nodes.counts);
            open.forEach((node, i) => (lower[node] = Math.max(0, Math.min(found[i], lower[node]))));
            nodes = halved(nodes, lower, axis, bit);
        }
    }
    return nodes.cells.map((cells) => repeated(cells, nodes.counts, count));
}

/**
 * @typedef {Object} Nodes of one level of the tree
 * @property {number} length
 * @property {Int32Array[]} cells x, y and z of their lowest corners
 * @property {Int32Array} counts of Gaussians
 * @property {Uint8Array} isOpen whether they are still divided
 * @property {Uint8Array} outcomes which halves of the node above hold something
 */

/** The node that holds all Gaussians. @type {(count: number) => Nodes} */
export function rootOf(count) {
    const nodes = newNodes(1);
    nodes.counts[0] = count;
    nodes.isOpen[0] = 1;
    return nodes;
}

/** New ones of the decisions that describe a tree. @type {(bits: number) => {splits: Models, stops: Models}} */
export const treeModels = (bits) => ({ splits: new Models(3 * COUNTS), stops: new Models(bits + 1) });

function newNodes(length) {
    return {
        length,
        cells: [0, 1, 2].map(() => new Int32Array(length)),
        counts: new Int32Array(length),
        isOpen: new Uint8Array(length),
        outcomes: new Uint8Array(length),
    };
}

/** Indices of the nodes that hold one Gaussian and are still divided. @type {(nodes: Nodes) => Int32Array} */
export const loneOf = ({ counts, isOpen }) => indicesWhere(counts.length, (i) => isOpen[i] && counts[i] === 1);

/** Indices of the nodes that are still divided. @type {(nodes: Nodes) => Int32Array} */
export const openOf = ({ isOpen }) => indicesWhere(isOpen.length, (i) => isOpen[i]);

function indicesWhere(length, holds) {
    const found = new Int32Array(length);
    let next = 0;
    for (let i = 0; i < length; i++) {
        if (holds(i)) {
            found[next++] = i;
        }
    }
    return found.subarray(0, next);
}

/** Of what open nodes' lower halves hold. @type {(nodes: Nodes, open: Int32Array) => Int32Array} */
export function contextsOf({ counts, outcomes }, open) {
    return open.map((node) => {
        const count = counts[node];
        return (count <= EXACT ? count : EXACT + 32 - Math.clz32(count)) + COUNTS * outcomes[node];
    });
}

/**
 * The halves of all nodes that hold something, in order.
 *
 * @param {Nodes} nodes
 * @param {Int32Array} lower how many Gaussians each node's lower half holds
 * @param {number} axis
 * @param {number} bit of the coordinate
 * @returns {Nodes}
 */
export function halved(nodes, lower, axis, bit) {
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
