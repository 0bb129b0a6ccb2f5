/**
 * Normal equations of a bundle adjustment, with the points eliminated by the Schur complement; the twin of
 * `prior/bundle/cpu/equations.py`, which says what the equations are.
 *
 * @module
 */

import { CAMERA_UNKNOWNS, COLUMNS, linearise, weigh } from "./reprojection.js";

/**
 * @typedef {import("./reprojection.js").Sightings} Sightings
 * @typedef {import("./reprojection.js").Estimate} Estimate
 * @typedef {import("./adjustment.js").BundleSettings} BundleSettings
 *
 * @typedef {Object} CameraEquations the cameras' side, of size D = 6 F
 * @property {Float64Array} matrix (D, D), of which only the lower triangle counts
 * @property {Float64Array} right (D,)
 * @property {Float64Array} diagonal (D,) before points are eliminated
 * @property {Float64Array} gradient (D,) likewise
 *
 * @typedef {Object} PointEquations the points' side
 * @property {Float64Array} inverses (N, 9) damped
 * @property {Float64Array} gradients (N, 3)
 * @property {Float64Array} damping (N, 3) added to the diagonals
 */

const AXES = [0, 1, 2];

/**
 * The equations for the cameras' steps with fixed points.
 *
 * @param {Sightings} sightings
 * @param {Estimate} estimate where to linearise
 * @param {BundleSettings} settings
 * @returns {CameraEquations}
 */
export function cameraEquations(sightings, estimate, { huber, grazing }) {
    const equations = emptyEquations(estimate.centres.length);
    const [residual, jacobian] = [new Float64Array(2), new Float64Array(2 * COLUMNS)];
    for (let k = 0; k < sightings.frame.length; k++) {
        if (linearise(sightings, estimate, k, grazing, residual, jacobian)) {
            weigh(residual, jacobian, huber);
            addToCameras(sightings.frame[k], residual, jacobian, equations);
        }
    }
    equations.right.set(equations.gradient);
    return equations;
}

/**
 * The equations for the cameras' steps with the points eliminated.
 *
 * @param {Sightings} sightings
 * @param {Estimate} estimate where to linearise
 * @param {BundleSettings} settings
 * @param {number} damping the points' diagonals grow by this factor of themselves
 * @returns {{cameras: CameraEquations, points: PointEquations}}
 */
export function reducedEquations(sightings, estimate, settings, damping) {
    const { huber, grazing, min_diagonal: least } = settings;
    const count = estimate.points.length / 3;
    const cameras = emptyEquations(estimate.centres.length);
    const points = {
        inverses: new Float64Array(9 * count),
        gradients: new Float64Array(3 * count),
        damping: new Float64Array(3 * count),
    };
    const [residual, jacobian] = [new Float64Array(2), new Float64Array(2 * COLUMNS)];
    for (let p = 0; p < count; p++) {
        const [first, end] = [sightings.starts[p], sightings.starts[p + 1]];
        const coupling = new Float64Array(3 * CAMERA_UNKNOWNS * (end - first));
        const matrix = new Float64Array(9);
        const gradient = points.gradients.subarray(3 * p, 3 * p + 3);
        for (let k = first; k < end; k++) {
            if (linearise(sightings, estimate, k, grazing, residual, jacobian)) {
                weigh(residual, jacobian, huber);
                addToCameras(sightings.frame[k], residual, jacobian, cameras);
                addToPoint(residual, jacobian, matrix, gradient);
                addToCoupling(jacobian, coupling, 3 * CAMERA_UNKNOWNS * (k - first));
            }
        }
        for (const axis of AXES) {
            points.damping[3 * p + axis] = damping * Math.max(matrix[4 * axis], least);
            matrix[4 * axis] += points.damping[3 * p + axis];
        }
        const inverse = points.inverses.subarray(9 * p, 9 * p + 9);
        invert(matrix, inverse);
        eliminate(sightings.frame.subarray(first, end), coupling, inverse, gradient, cameras);
    }
    cameras.right.forEach((value, i) => (cameras.right[i] = value + cameras.gradient[i]));
    return { cameras, points };
}

/**
 * Steps of the points for a step of the cameras: back-substitution.
 *
 * @param {Sightings} sightings
 * @param {Estimate} estimate where the equations were linearised
 * @param {BundleSettings} settings
 * @param {PointEquations} points from `reducedEquations`
 * @param {Float64Array} cameraStep (D,)
 * @returns {Float64Array} (N, 3)
 */
export function pointSteps(sightings, estimate, { huber, grazing }, points, cameraStep) {
    const steps = new Float64Array(estimate.points.length);
    const [residual, jacobian] = [new Float64Array(2), new Float64Array(2 * COLUMNS)];
    for (let p = 0; p < steps.length / 3; p++) {
        const right = points.gradients.slice(3 * p, 3 * p + 3);
        for (let k = sightings.starts[p]; k < sightings.starts[p + 1]; k++) {
            if (linearise(sightings, estimate, k, grazing, residual, jacobian)) {
                weigh(residual, jacobian, huber);
                subtractMotion(jacobian, cameraStep, CAMERA_UNKNOWNS * sightings.frame[k], right);
            }
        }
        for (const axis of AXES) {
            const row = 9 * p + 3 * axis;
            const [a, b, c] = points.inverses.subarray(row, row + 3);
            steps[3 * p + axis] = a * right[0] + b * right[1] + c * right[2];
        }
    }
    return steps;
}

function subtractMotion(jacobian, cameraStep, camera, right) {
    for (const row of [0, COLUMNS]) {
        let moved = 0;
        for (let a = 0; a < CAMERA_UNKNOWNS; a++) {
            moved += jacobian[row + a] * cameraStep[camera + a];
        }
        for (const axis of AXES) {
            right[axis] -= jacobian[row + CAMERA_UNKNOWNS + axis] * moved;
        }
    }
}

/** @returns {CameraEquations} */
function emptyEquations(cameras) {
    const size = CAMERA_UNKNOWNS * cameras;
    const [right, diagonal, gradient] = AXES.map(() => new Float64Array(size));
    return { matrix: new Float64Array(size * size), right, diagonal, gradient };
}

function addToCameras(frame, residual, j, { matrix, diagonal, gradient }) {
    for (let a = 0; a < CAMERA_UNKNOWNS; a++) {
        const row = CAMERA_UNKNOWNS * frame + a;
        gradient[row] -= j[a] * residual[0] + j[COLUMNS + a] * residual[1];
        diagonal[row] += j[a] ** 2 + j[COLUMNS + a] ** 2;
        for (let b = 0; b <= a; b++) {
            const at = row * gradient.length + CAMERA_UNKNOWNS * frame + b;
            matrix[at] += j[a] * j[b] + j[COLUMNS + a] * j[COLUMNS + b];
        }
    }
}

function addToPoint(residual, j, matrix, gradient) {
    for (const a of AXES) {
        const [left, right] = [j[CAMERA_UNKNOWNS + a], j[COLUMNS + CAMERA_UNKNOWNS + a]];
        gradient[a] -= left * residual[0] + right * residual[1];
        for (const b of AXES) {
            matrix[3 * a + b] += left * j[CAMERA_UNKNOWNS + b] + right * j[COLUMNS + CAMERA_UNKNOWNS + b];
        }
    }
}

function addToCoupling(j, coupling, first) {
    for (let a = 0; a < CAMERA_UNKNOWNS; a++) {
        for (const axis of AXES) {
            const [down, across] = [j[CAMERA_UNKNOWNS + axis], j[COLUMNS + CAMERA_UNKNOWNS + axis]];
            coupling[first + 3 * a + axis] += j[a] * down + j[COLUMNS + a] * across;
        }
    }
}

/**
 * Write the inverse of a positive definite 3 x 3 matrix by its Cholesky factor L: (L⁻¹)ᵀ L⁻¹. Cofactors would lose all
 * digits for a point that is seen with little parallax.
 */
function invert(m, inverse) {
    const a = 1 / Math.sqrt(m[0]);
    const [l10, l20] = [m[3] * a, m[6] * a];
    const b = 1 / Math.sqrt(m[4] - l10 * l10);
    const l21 = (m[7] - l20 * l10) * b;
    const c = 1 / Math.sqrt(m[8] - l20 * l20 - l21 * l21);
    const [i10, i21] = [-l10 * a * b, -l21 * b * c];
    const i20 = -(l20 * a + l21 * i10) * c;
    inverse[0] = a * a + i10 * i10 + i20 * i20;
    inverse[4] = b * b + i21 * i21;
    inverse[8] = c * c;
    inverse[1] = inverse[3] = i10 * b + i20 * i21;
    inverse[2] = inverse[6] = i20 * c;
    inverse[5] = inverse[7] = i21 * c;
}

/** Subtract what one point couples: H_cp H_pp⁻¹ H_pc and H_cp H_pp⁻¹ b_p. */
function eliminate(frames, coupling, inverse, gradient, { matrix, right }) {
    const block = 3 * CAMERA_UNKNOWNS;
    for (let i = 0; i < frames.length; i++) {
        for (let a = 0; a < CAMERA_UNKNOWNS; a++) {
            const at = block * i + 3 * a;
            const [x, y, z] = [coupling[at], coupling[at + 1], coupling[at + 2]];
            const u = x * inverse[0] + y * inverse[3] + z * inverse[6];
            const v = x * inverse[1] + y * inverse[4] + z * inverse[7];
            const w = x * inverse[2] + y * inverse[5] + z * inverse[8];
            const row = CAMERA_UNKNOWNS * frames[i] + a;
            right[row] -= u * gradient[0] + v * gradient[1] + w * gradient[2];
            for (let j = 0; j < frames.length; j++) {
                if (frames[j] > frames[i]) {
                    continue;
                }
                for (let b = 0; b < CAMERA_UNKNOWNS; b++) {
                    const other = block * j + 3 * b;
                    const shared = u * coupling[other] + v * coupling[other + 1] + w * coupling[other + 2];
                    matrix[row * right.length + CAMERA_UNKNOWNS * frames[j] + b] -= shared;
                }
            }
        }
    }
}
