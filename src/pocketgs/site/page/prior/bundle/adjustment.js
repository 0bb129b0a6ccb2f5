/**
 * Bundle adjustment: optimises poses and points for the reprojection error; the twin of `prior/bundle/adjustment.py`
 * with a prior on every pose.
 *
 * @module
 */

import { centreOf } from "../../capture/camera.js";
import { factorise, substitute } from "../../numbers/cholesky.js";
import { product, rotationAbout, transposed, vectorOf } from "../../numbers/rotations.js";
import { dot } from "../../../page/scene/vectors.js";
import { startsOf } from "../features/observations.js";
import { minimise } from "./levenberg_marquardt.js";
import { CAMERA_UNKNOWNS, distances } from "./reprojection.js";
import { cameraEquations, pointSteps, reducedEquations } from "./schur.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 * @typedef {import("./reprojection.js").Estimate} Estimate
 *
 * @typedef {Object} BundleSettings
 * @property {number} huber reprojection error in pixels above which the loss is linear
 * @property {number} iterations maximum number of steps
 * @property {number} tolerance stop when a step reduces the cost by less than this share
 * @property {number} position_sigma standard deviation of the given centres, in scene units; infinite for no prior
 * @property {number} rotation_sigma standard deviation of the given rotations, in radians; infinite for no prior
 * @property {number} grazing minimum cosine of the angle to the optical axis for a point in front of the camera
 * @property {number} behind reprojection error in pixels of other points
 * @property {number} first_damping as a share of the diagonal of JᵀJ
 * @property {number} min_damping the same
 * @property {number} min_diagonal lower bound of what damping is a share of
 * @property {number} negligible smaller decreases of the cost are rounding errors
 */

/**
 * Optimise poses and points.
 *
 * @param {Camera[]} given the centre of the prior
 * @param {Float64Array} points (N, 3) start; each is observed by two cameras or more
 * @param {Observations} observations sorted by point
 * @param {BundleSettings} settings
 * @param {Camera[]} start initial poses
 * @returns {{cameras: Camera[], points: Float64Array, residuals: Float64Array}} residuals: lengths in pixels
 */
export function adjustBundle(given, points, observations, settings, start) {
    const sightings = { ...observations, intrinsics: given.map(intrinsicsOf), starts: startsOf(observations) };
    const prior = posePrior(given, settings);
    const step = (estimate, damping) => {
        const equations = reducedEquations(sightings, estimate, settings, damping);
        const solved = solve(equations.cameras, prior, settings, estimate, damping);
        if (!solved) {
            return null;
        }
        const moves = pointSteps(sightings, estimate, settings, equations.points, solved.step);
        const { damping: added, gradients } = equations.points;
        const gained = moves.reduce((sum, move, i) => sum + 0.5 * move * (added[i] * move + gradients[i]), 0);
        const moved = estimate.points.map((value, i) => value + moves[i]);
        return { next: movedBy(estimate, solved.step, moved), expected: solved.expected + gained };
    };
    const found = minimise(estimateOf(start, points), costOf(sightings, prior, settings), step, settings);
    return { cameras: posed(given, found), points: found.points, residuals: distances(sightings, found, settings) };
}

/**
 * Optimise one pose with fixed points.
 *
 * @param {Camera} camera start, and centre of the prior
 * @param {Float64Array} points (M, 3)
 * @param {Float64Array} pixels (M, 2)
 * @param {BundleSettings} settings
 * @returns {Camera}
 */
export function adjustPose(camera, points, pixels, settings) {
    const each = Int32Array.from({ length: pixels.length / 2 }, (_, i) => i);
    const sightings = { frame: each.map(() => 0), point: each, pixels, intrinsics: [intrinsicsOf(camera)] };
    const prior = posePrior([camera], settings);
    const step = (estimate, damping) => {
        const solved = solve(cameraEquations(sightings, estimate, settings), prior, settings, estimate, damping);
        return solved && { next: movedBy(estimate, solved.step, points), expected: solved.expected };
    };
    const cost = costOf(sightings, prior, settings);
    return posed([camera], minimise(estimateOf([camera], points), cost, step, settings))[0];
}

const intrinsicsOf = ({ fx, fy, cx, cy }) => [fx, fy, cx, cy];

/** @returns {Estimate} */
function estimateOf(cameras, points) {
    return { rotations: cameras.map(rotationOf), centres: cameras.map(centreOf), points };
}

const rotationOf = ({ world_to_camera: m }) => [0, 4, 8].flatMap((first) => m.slice(first, first + 3));

/** Half the sum of the Huber losses (Huber 1964) and of the weighted squares of the deviations from the given poses. */
function costOf(sightings, prior, settings) {
    const { huber } = settings;
    return (estimate) => {
        const loss = distances(sightings, estimate, settings).reduce((sum, length) => {
            const inner = Math.min(length, huber);
            return sum + inner * (length - 0.5 * inner);
        }, 0);
        const deviation = prior.deviation(estimate);
        return loss + deviation.reduce((sum, value, i) => sum + 0.5 * prior.weights[i] * value ** 2, 0);
    };
}

/** A Gaussian around each given pose; the twin of `prior/bundle/pose_prior.py`. */
function posePrior(given, { rotation_sigma: turn, position_sigma: offset }) {
    const { rotations, centres } = estimateOf(given, null);
    const backwards = rotations.map(transposed);
    const weights = given.flatMap(() => [turn, turn, turn, offset, offset, offset].map((sigma) => 1 / sigma ** 2));
    const deviation = (estimate) =>
        given.flatMap((_, i) => [
            ...vectorOf(product(estimate.rotations[i], backwards[i])),
            ...estimate.centres[i].map((value, axis) => value - centres[i][axis]),
        ]);
    return { weights, deviation };
}

/**
 * A step of the cameras, and their part of the expected decrease: ½ hᵀ (μ D h + b) (Madsen, Nielsen and Tingleff 2004,
 * equation 3.14). Null if the matrix is not positive definite.
 */
function solve({ matrix, right, diagonal, gradient }, prior, { min_diagonal: least }, estimate, damping) {
    const size = right.length;
    const slope = prior.deviation(estimate).map((value, i) => -prior.weights[i] * value);
    const added = diagonal.map((value, i) => damping * Math.max(value + prior.weights[i], least));
    for (let i = 0; i < size; i++) {
        matrix[i * size + i] += prior.weights[i] + added[i];
    }
    if (!factorise(matrix, size)) {
        return null;
    }
    const step = right.map((value, i) => value + slope[i]);
    substitute(matrix, step);
    const expected = step.reduce((sum, h, i) => sum + 0.5 * h * (added[i] * h + gradient[i] + slope[i]), 0);
    return { step, expected };
}

function movedBy({ rotations, centres }, step, points) {
    const of = (camera, first) => step.subarray(CAMERA_UNKNOWNS * camera + first, CAMERA_UNKNOWNS * camera + first + 3);
    return {
        rotations: rotations.map((rotation, i) => product(rotationAbout(of(i, 0)), rotation)),
        centres: centres.map((centre, i) => centre.map((value, axis) => value + of(i, 3)[axis])),
        points,
    };
}

/** The cameras with the poses of the estimate. */
function posed(cameras, { rotations, centres }) {
    return cameras.map((camera, i) => {
        const rows = [0, 3, 6].map((first) => rotations[i].slice(first, first + 3));
        const pose = rows.flatMap((row) => [...row, -dot(row, centres[i])]);
        return { ...camera, world_to_camera: [...pose, 0, 0, 0, 1] };
    });
}
