/**
 * Rounding to the grids of a `.pgs`; the twin of `formats/pgs_rounding.py` and `pgs_rotations.py`, which document them.
 *
 * @module
 */

import { finenessOf, stepOf } from "../../page/formats/pgs_rotations.js";
import { roundedToEven } from "../numbers/rounding.js";

/**
 * The nearest multiples of a step, within bounds.
 *
 * @param {Float32Array} values
 * @param {number} step
 * @param {number} most the largest multiple
 * @returns {Int32Array}
 */
export const levelsOf = (values, step, most) =>
    Int32Array.from(values, (value) => Math.max(-most, Math.min(roundedToEven(value / step), most)));

/**
 * Round each centre to a power of two of at most a share of the Gaussian's middle standard deviation.
 *
 * @param {Float32Array[]} means x, y and z
 * @param {Float32Array[]} logScales along three axes
 * @param {number} share
 * @param {number} bits of a coordinate
 * @returns {{exponent: number, origin: number[], cells: Int32Array[]}} the exponent of the coarsest step of all, the
 *     lowest corner and the cells from there, in steps
 */
export function roundedMeans(means, [a, b, c], share, bits) {
    const finest = finestExponent(means, bits);
    const steps = Float64Array.from(a, (_, i) => {
        const middle = Math.max(Math.min(a[i], b[i]), Math.min(Math.max(a[i], b[i]), c[i]));
        const own = Math.floor(middle / Math.log(2) + Math.log2(share));
        // The largest coordinate may be rounded up to the next power of two, and must not vanish.
        return 2 ** Math.max(finest + 1, Math.min(own, finest + bits - 1));
    });
    const rounded = means.map((values) => Float32Array.from(values, (x, i) => roundedToEven(x / steps[i]) * steps[i]));
    return inSteps(rounded, finestExponent(rounded, bits));
}

/** Rounded centres as multiples of the largest power of two that allows it. */
function inSteps(means, finest) {
    const multiples = means.map((values) => Int32Array.from(values, (value) => value * 2 ** -finest));
    const together = multiples.reduce((all, column) => column.reduce((sum, value) => sum | Math.abs(value), all), 0);
    const shift = together ? 31 - Math.clz32(together & -together) : 0;
    const shifted = multiples.map((column) => column.map((value) => value >> shift));
    const origin = shifted.map((column) => column.reduce((least, value) => Math.min(least, value), column[0]));
    const cells = shifted.map((column, axis) => column.map((value) => value - origin[axis]));
    return { exponent: together ? finest + shift : 0, origin, cells };
}

/** Exponent of the smallest step that the format allows for these coordinates. */
function finestExponent(means, bits) {
    const largest = means.reduce((most, column) => column.reduce((sum, x) => Math.max(sum, Math.abs(x)), most), 0);
    const words = new Uint32Array(Float64Array.of(largest).buffer);
    return (largest ? ((words[1] >>> 20) & 0x7ff) - 1022 : 0) - bits;
}

/**
 * Name the axes of Gaussians in the order of the format, and round their rotations.
 *
 * @param {Int32Array[]} scales levels of log scales
 * @param {Float32Array[]} quaternions w, x, y, z
 * @param {{log_scale: number, rotation: number}} coding
 * @param {{quaternion: number[], axes: number[]}[]} renamings the rotations that map a cube onto itself, and the old
 *     axis that each new one is
 * @returns {{scales: Int32Array[], turns: Int32Array[], fineness: {swing: Uint8Array, twist: Uint8Array}}}
 */
export function roundedRotations(scales, quaternions, coding, renamings) {
    const of = (axes) => renamings.filter((renaming) => String(renaming.axes) === String(axes));
    const byOrder = new Map([0, 1, 2].flatMap((x) => [0, 1, 2].map((y) => [3 * x + y, of([x, y, 3 - x - y])])));
    const named = scales.map((column) => new Int32Array(column.length));
    const turns = scales.map((column) => new Float64Array(column.length));
    for (let i = 0; i < scales[0].length; i++) {
        const axes = axesOf(scales.map((column) => column[i]));
        const choices = byOrder.get(3 * axes[0] + axes[1]);
        const own = leastTurn(quaternions.map((column) => column[i]), choices);
        axes.forEach((axis, place) => (named[place][i] = scales[axis][i]));
        own.forEach((turn, place) => (turns[place][i] = turn));
    }
    const fineness = finenessOf(named.map((column) => Float64Array.from(column, (level) => level * coding.log_scale)));
    const finenesses = [fineness.swing, fineness.swing, fineness.twist];
    const levels = turns.map((column, place) =>
        Int32Array.from(column, (turn, i) => roundedToEven(turn / stepOf(finenesses[place][i], coding.rotation))),
    );
    return { scales: named, turns: levels, fineness };
}

/** The order of axes in which z differs most from the others, and x is not shorter than y. */
function axesOf(levels) {
    const order = [0, 1, 2].sort((a, b) => levels[b] - levels[a]);
    const [longest, middle, shortest] = order.map((axis) => levels[axis]);
    return longest - middle > middle - shortest ? [order[1], order[2], order[0]] : order;
}

/** p, r and t of a rotation, with the least turns of its descriptions. */
function leastTurn(quaternion, choices) {
    let [best, least] = [[0, 0, 0], Infinity];
    for (const { quaternion: renaming } of choices) {
        const [w, x, y, z] = composed(quaternion, renaming);
        const [a, b, t] = [x / w, y / w, z / w];
        const [p, r] = [(a - t * b) / (1 + t * t), (b + t * a) / (1 + t * t)];
        const turn = Math.max(Math.abs(t), Math.hypot(p, r));
        if (turn < least) {
            [best, least] = [[p, r, t], turn];
        }
    }
    return best;
}

function composed([w, x, y, z], [otherW, otherX, otherY, otherZ]) {
    return [
        w * otherW - x * otherX - y * otherY - z * otherZ,
        w * otherX + x * otherW + y * otherZ - z * otherY,
        w * otherY + y * otherW + z * otherX - x * otherZ,
        w * otherZ + z * otherW + x * otherY - y * otherX,
    ];
}
