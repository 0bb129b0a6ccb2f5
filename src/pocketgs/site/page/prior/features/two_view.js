/**
 * Two-view geometry: matches that one rigid motion explains. Python finds the motion from the matches alone
 * (`prior/features/two_view.py`); here the given poses are where it starts.
 *
 * @module
 */

import { product, rotationAbout } from "../../numbers/rotations.js";
import { factorise, substitute } from "../../numbers/cholesky.js";
import { relativePose } from "../source_views.js";
import { cross, normalised } from "../../../page/scene/vectors.js";

/** @typedef {import("../../capture/camera.js").Camera} Camera */

/** Steps of the refinement, and the factor by which the tolerance shrinks from step to step. */
const [STEPS, SHRINKING] = [14, 0.7];

/** Step of finite differences: in radians, of the rotation and the direction of the translation. */
const STEP = 1e-6;

const UNKNOWNS = 5;

/**
 * The matches that agree with one motion, near the given one.
 *
 * @param {Camera} first
 * @param {Camera} second
 * @param {Float64Array} here (M, 2) pixels in the first view
 * @param {Float64Array} there (M, 2) pixels in the second
 * @param {number} tolerance distance from epipolar lines in pixels
 * @param {Object} settings the settings' `two_view`
 * @returns {Uint8Array} (M,) all 0 if too few agree
 */
export function agreeing(first, second, here, there, tolerance, settings) {
    const count = here.length / 2;
    const nothing = new Uint8Array(count);
    if (count < settings.min_matches) {
        return nothing;
    }
    const focal = (first.fx * first.fy * second.fx * second.fy) ** 0.25;
    const rays = { one: raysOf(first, here), other: raysOf(second, there), focal };
    const { rotation, translation } = relativePose(first, second);
    let motion = { rotation: rotation.flat(), direction: directionOf(translation) };
    let width = settings.widest * Math.max(first.width, first.height);
    for (let step = 0; step < STEPS; step++) {
        motion = refined(motion, rays, Math.max(width, tolerance));
        width *= SHRINKING;
    }
    const agrees = Uint8Array.from(distances(motion, rays), (distance) => Number(Math.abs(distance) < tolerance));
    const enough = Math.max(settings.min_matches, settings.min_share * count);
    return agrees.reduce((sum, value) => sum + value, 0) >= enough ? agrees : nothing;
}

/** Where the second camera moved; any direction will do for a camera that only turned: all explain its matches. */
function directionOf(translation) {
    return Math.hypot(...translation) > 1e-12 ? normalised(translation) : [0, 0, 1];
}

function raysOf({ fx, fy, cx, cy }, pixels) {
    return pixels.map((value, i) => (i % 2 ? (value - cy) / fy : (value - cx) / fx));
}

/** A Gauss-Newton step on the Sampson distances, with the weights of the Cauchy loss (Zhang 1997, section 9). */
function refined(motion, rays, width) {
    const before = distances(motion, rays);
    const slopes = Array.from({ length: UNKNOWNS }, (_, unknown) => {
        const step = new Float64Array(UNKNOWNS);
        step[unknown] = STEP;
        return distances(moved(motion, step), rays).map((distance, i) => (distance - before[i]) / STEP);
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
    return moved(motion, right);
}

/** A motion after turning it by three numbers and its direction by two. */
function moved({ rotation, direction }, step) {
    const aside = normalised(cross(direction, Math.abs(direction[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0]));
    const up = cross(direction, aside);
    const turned = direction.map((value, i) => value + step[3] * aside[i] + step[4] * up[i]);
    return { rotation: product(rotationAbout(step.subarray(0, 3)), rotation), direction: normalised(turned) };
}

/** Signed Sampson distances in pixels (Hartley and Zisserman, "Multiple view geometry", section 11.4.3). */
function distances({ rotation, direction: [x, y, z] }, { one, other, focal }) {
    const e = product([0, -z, y, z, 0, -x, -y, x, 0], rotation);
    return Float64Array.from({ length: one.length / 2 }, (_, i) => {
        const [u, v, s, t] = [one[2 * i], one[2 * i + 1], other[2 * i], other[2 * i + 1]];
        const [a, b] = [e[0] * u + e[1] * v + e[2], e[3] * u + e[4] * v + e[5]];
        const [c, d] = [e[0] * s + e[3] * t + e[6], e[1] * s + e[4] * t + e[7]];
        const off = s * a + t * b + (e[6] * u + e[7] * v + e[8]);
        return (focal * off) / Math.max(Math.hypot(a, b, c, d), 1e-12);
    });
}
