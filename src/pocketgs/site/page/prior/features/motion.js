/**
 * Refinement of the motion between two views.
 *
 * @module
 */

import { factorise, substitute } from "../../numbers/cholesky.js";
import { product, rotationAbout } from "../../numbers/rotations.js";
import { cross, normalised } from "../../../page/scene/vectors.js";
import { essentialOf, sampsonDistances } from "./epipolar.js";

/**
 * @typedef {import("./epipolar.js").Motion} Motion
 * @typedef {import("./epipolar.js").Rays} Rays
 */

/** The factor by which the width shrinks from one step to the next. */
const SHRINKING = 0.7;

/** Step of finite differences: in radians, of the rotation and the direction of the translation. */
const STEP = 1e-6;

/** Of a step, the least share that is tried. */
const SHORTEST = 1 / 100;

const UNKNOWNS = 5;

/**
 * The matches that agree with a motion, once it is refined by matches within a width that shrinks to the tolerance.
 *
 * @param {Motion} motion
 * @param {Rays} rays
 * @param {number} width distance from epipolar lines in pixels
 * @param {number} tolerance the same
 * @returns {Uint8Array} (M,)
 */
export function narrowed(motion, rays, width, tolerance) {
    for (; width > tolerance; width *= SHRINKING) {
        motion = refined(motion, rays, width);
    }
    motion = refined(refined(motion, rays, tolerance), rays, tolerance);
    const distances = sampsonDistances(essentialOf(motion), rays);
    return Uint8Array.from(distances, (distance) => Number(Math.abs(distance) < tolerance));
}

/**
 * A Gauss-Newton step on the Sampson distances, with the weights of the Cauchy loss (Zhang 1997, section 9). It is made
 * shorter until the loss falls: distances of wrong matches are far from linear.
 */
function refined(motion, rays, width) {
    const distancesOf = (one) => sampsonDistances(essentialOf(one), rays);
    const before = distancesOf(motion);
    const slopes = Array.from({ length: UNKNOWNS }, (_, unknown) => {
        const step = new Float64Array(UNKNOWNS);
        step[unknown] = STEP;
        return distancesOf(moved(motion, step)).map((distance, i) => (distance - before[i]) / STEP);
    });
    const [matrix, right] = [new Float64Array(UNKNOWNS ** 2), new Float64Array(UNKNOWNS)];
    before.forEach((distance, i) => {
        const weight = 1 / (1 + (distance / width) ** 2);
        for (let row = 0; row < UNKNOWNS; row++) {
            right[row] -= weight * slopes[row][i] * distance;
            for (let column = 0; column < UNKNOWNS; column++) {
                matrix[UNKNOWNS * row + column] += weight * slopes[row][i] * slopes[column][i];
            }
        }
    });
    for (let row = 0; row < UNKNOWNS; row++) {
        // Without parallax the matches say nothing of the direction.
        matrix[(UNKNOWNS + 1) * row] += 1e-6 * matrix[(UNKNOWNS + 1) * row] + 1e-9;
    }
    if (!factorise(matrix, UNKNOWNS)) {
        return motion;
    }
    substitute(matrix, right);
    const loss = (distances) => distances.reduce((sum, distance) => sum + Math.log1p((distance / width) ** 2), 0);
    for (let share = 1; share > SHORTEST; share /= 2) {
        const next = moved(motion, right.map((value) => share * value));
        if (loss(distancesOf(next)) < loss(before)) {
            return next;
        }
    }
    return motion;
}

/** A motion after turning it by three numbers and its direction by two. */
function moved({ rotation, direction }, step) {
    const aside = normalised(cross(direction, Math.abs(direction[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0]));
    const up = cross(direction, aside);
    const turned = direction.map((value, i) => value + step[3] * aside[i] + step[4] * up[i]);
    return { rotation: product(rotationAbout(step.subarray(0, 3)), rotation), direction: normalised(turned) };
}
