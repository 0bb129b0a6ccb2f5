/**
 * Discs on the surfaces that points lie on; the twin of `seed_discs` in `training/seeding.py`.
 *
 * @module
 */

import { dcOf, GaussianColumns } from "../../page/scene/gaussian_columns.js";
import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../../page/scene/gaussian_columns.js";
import { cross, rotationTo } from "../../page/scene/vectors.js";
import { medianOf } from "../numbers/median.js";
import { eigenvectors } from "./eigenvectors.js";
import { NeighbourTree } from "./neighbours.js";

/**
 * Place a disc at every point, tangent to the plane through its neighbours.
 *
 * @param {import("../capture/listing.js").Cloud} cloud
 * @param {{opacity: number, seed_size: number, coefficients: number}} recipe
 * @param {{plane_neighbours: number, spacing_neighbours: number, thickness: number}} seeding
 * @returns {GaussianColumns}
 */
export function seedDiscs({ positions, colours }, recipe, seeding) {
    const count = positions.length / 3;
    const tree = new NeighbourTree(positions);
    const scene = new GaussianColumns(count, recipe.coefficients);
    const spacing = new Float64Array(count);
    const around = Math.min(seeding.plane_neighbours + 1, count);
    for (let i = 0; i < count; i++) {
        const { points, squares } = tree.nearest(i, around);
        const nearest = squares.slice(1, seeding.spacing_neighbours + 1).map(Math.sqrt);
        spacing[i] = nearest.reduce((sum, distance) => sum + distance, 0) / nearest.length;
        const quaternion = tangentTo(points, positions);
        for (let axis = 0; axis < 3; axis++) {
            scene.column(MEAN + axis)[i] = positions[3 * i + axis];
            scene.harmonics(0, axis)[i] = dcOf(colours[3 * i + axis]);
        }
        quaternion.forEach((value, part) => (scene.column(QUATERNION + part)[i] = value));
    }
    // Coincident points would give Gaussians of size zero.
    const least = 0.01 * medianOf(spacing) + 1.1754944e-38;
    for (let i = 0; i < count; i++) {
        const size = recipe.seed_size * Math.max(spacing[i], least);
        [1, 1, seeding.thickness].forEach((share, axis) => {
            scene.column(LOG_SCALE + axis)[i] = Math.log(size * share);
        });
    }
    scene.column(OPACITY_LOGIT).fill(Math.log(recipe.opacity / (1 - recipe.opacity)));
    return scene;
}

/** The rotation whose z-axis is the normal of the plane through some points. */
function tangentTo(points, positions) {
    const middle = [0, 1, 2].map((axis) => points.reduce((sum, i) => sum + positions[3 * i + axis], 0) / points.length);
    const covariance = [0, 1, 2].map(() => [0, 0, 0]);
    for (const i of points) {
        const offset = middle.map((value, axis) => positions[3 * i + axis] - value);
        offset.forEach((a, row) => offset.forEach((b, column) => (covariance[row][column] += (a * b) / points.length)));
    }
    const [normal, , tangent] = eigenvectors(covariance);
    return rotationTo([tangent, cross(normal, tangent), normal]);
}
