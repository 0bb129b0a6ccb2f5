/**
 * The motion between two views from their matches alone.
 *
 * @module
 */

import { kernelOf } from "../../numbers/kernel.js";
import { Generator } from "../../random/generator.js";
import { trialsFor } from "../../random/trials.js";
import { cross, dot, normalised } from "../../../page/scene/vectors.js";
import { sampsonDistances } from "./epipolar.js";
import { narrowed } from "./motion.js";

/**
 * @typedef {import("./epipolar.js").Motion} Motion
 * @typedef {import("./epipolar.js").Rays} Rays
 */

const SAMPLE = 8;

/** The tolerance of samples, in units of the final one: eight matches determine a motion only roughly. */
const WIDTH = 4;

/** The same random numbers serve all pairs of views. @type {Float64Array | null} */
let drawn = null;

/**
 * The matches that agree with the motion that most agree with: RANSAC (Fischler and Bolles 1981) over eight matches at
 * a time, which give an essential matrix by linear equations (Longuet-Higgins 1981). Each that more matches agree with
 * than with those before is refined (LO-RANSAC, Chum et al. 2003).
 *
 * @param {Rays} rays
 * @param {number} tolerance distance from epipolar lines in pixels
 * @param {Uint8Array} known (M,) matches that agree with a known motion
 * @param {{confidence: number, trials: number}} settings the settings' `two_view`
 * @returns {Uint8Array} (M,) the known ones if no others are more
 */
export function sampled(rays, tolerance, known, { confidence, trials }) {
    const width = WIDTH * tolerance;
    drawn ??= drawnFor(trials);
    let [agrees, most, mostNear] = [known, sum(known), 0];
    for (let trial = 0; trial < Math.min(trials, trialsFor(most / known.length, SAMPLE, confidence)); trial++) {
        const essential = essentialThrough(rays, trial);
        if (!essential) {
            continue;
        }
        const near = sampsonDistances(essential, rays).reduce((count, one) => count + (Math.abs(one) < width), 0);
        if (near <= mostNear) {
            continue;
        }
        mostNear = near;
        const found = narrowed(motionOf(essential), rays, width, tolerance);
        if (sum(found) > most) {
            [agrees, most] = [found, sum(found)];
        }
    }
    return agrees;
}

const sum = (flags) => flags.reduce((total, flag) => total + flag, 0);

function drawnFor(trials) {
    const random = new Generator(0);
    return Float64Array.from({ length: SAMPLE * trials }, () => random.uniform(0, 1));
}

/** The essential matrix that a trial's sample determines, not exactly one; null for a degenerate sample. */
function essentialThrough({ one, other }, trial) {
    const matrix = new Float64Array(9 * SAMPLE);
    const count = one.length / 2;
    for (let row = 0; row < SAMPLE; row++) {
        const i = Math.floor(count * drawn[SAMPLE * trial + row]);
        const [u, v, s, t] = [one[2 * i], one[2 * i + 1], other[2 * i], other[2 * i + 1]];
        matrix.set([s * u, s * v, s, t * u, t * v, t, u, v, 1], 9 * row);
    }
    return kernelOf(matrix, SAMPLE);
}

/**
 * A motion with nearly this essential matrix E = [t]ₓ R, of the four with the same epipolar lines (Horn 1990): t tᵀ is
 * ½ tr(E Eᵀ) I - E Eᵀ, and (t · t) R is cof(E) - [t]ₓ E.
 */
function motionOf(e) {
    const rows = [0, 3, 6].map((at) => [...e.subarray(at, at + 3)]);
    const squares = rows.map((row) => dot(row, row));
    const half = (squares[0] + squares[1] + squares[2]) / 2;
    const largest = squares.indexOf(Math.min(...squares));
    const scale = 1 / Math.sqrt(half - squares[largest]);
    const t = rows.map((row, i) => scale * ((i === largest ? half : 0) - dot(row, rows[largest])));
    const cofactors = [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])];
    const columns = [0, 1, 2].map((column) => cross(t, rows.map((row) => row[column])));
    const [x, y] = [0, 1].map((i) => cofactors[i].map((value, column) => value - columns[column][i]));
    const across = normalised(x);
    const forward = normalised(cross(across, y));
    return { rotation: [...across, ...cross(forward, across), ...forward], direction: normalised(t) };
}
