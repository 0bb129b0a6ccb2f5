/**
 * Where a set of cameras looks; the twin of `geometry/camera_geometry.py`.
 *
 * @module
 */

import { centreOf, forwardOf } from "../capture/camera.js";
import { add, dot, length, normalised, subtract } from "../../page/scene/vectors.js";
import { eigenvectors } from "./eigenvectors.js";

/**
 * The point nearest to all optical axes. Where the axes are parallel it is placed in front of the cameras.
 *
 * @param {import("../capture/camera.js").Camera[]} cameras
 * @param {{min_convergence: number, guessed_distance: number}} settings the settings' `volume`
 * @returns {[number, number, number]}
 */
export function focusPoint(cameras, settings) {
    const [centres, forwards] = [cameras.map(centreOf), cameras.map(forwardOf)];
    const centre = meanOf(centres);
    const spread = spreadOf(centres);
    const guess = add(centre, meanDirection(forwards), spread > 0 ? settings.guessed_distance * spread : 1);
    const across = [0, 1, 2].map((i) =>
        [0, 1, 2].map((j) => forwards.reduce((sum, f) => sum + (i === j) - f[i] * f[j], 0) / forwards.length),
    );
    const residual = meanOf(centres.map((one, i) => withoutPart(subtract(one, guess), forwards[i])));
    return add(guess, leastSquares(across, residual, settings.min_convergence));
}

/** @type {(vectors: number[][]) => [number, number, number]} */
export function meanOf(vectors) {
    return [0, 1, 2].map((axis) => vectors.reduce((sum, v) => sum + v[axis], 0) / vectors.length);
}

/** Root mean square of the distances from the mean; 0 within rounding. @type {(points: number[][]) => number} */
export function spreadOf(points) {
    const mean = meanOf(points);
    const squares = points.map((one) => length(subtract(one, mean)) ** 2);
    const spread = Math.sqrt(squares.reduce((sum, square) => sum + square, 0) / squares.length);
    return spread > 1e-9 * Math.max(...points.flat().map(Math.abs), 1e-9) ? spread : 0;
}

/** Whether the point lies in front of more than half of the cameras, which are not all in one place. */
export function looksAt(cameras, point) {
    const inFront = cameras.filter((camera) => dot(forwardOf(camera), subtract(point, centreOf(camera))) > 0);
    const areApart = cameras.length === 1 || spreadOf(cameras.map(centreOf)) > 0;
    return areApart && 2 * inFront.length > cameras.length;
}

/** The shortest solution of a symmetric system, without directions that it hardly determines. */
function leastSquares(matrix, right, least) {
    const vectors = eigenvectors(matrix);
    const values = vectors.map((v) => dot(v, matrix.map((row) => dot(row, v))));
    const largest = Math.max(...values);
    return vectors.reduce(
        (sum, v, i) => (values[i] > least * largest ? add(sum, v, dot(v, right) / values[i]) : sum),
        [0, 0, 0],
    );
}

const withoutPart = (vector, direction) => add(vector, direction, -dot(vector, direction));

function meanDirection(directions) {
    const mean = meanOf(directions);
    return length(mean) > 1e-9 ? normalised(mean) : directions[0];
}
