/**
 * Discs on the surfaces that points lie on; the twin of `seed_discs` in `seeding/seeds.py`.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../../page/constants.js";
import { dcOf, GaussianColumns } from "../../page/scene/gaussian_columns.js";
import { cross, rotationTo } from "../../page/scene/vectors.js";
import { medianOf } from "../numbers/quantiles.js";

/**
 * Place a disc at every point, tangent to the plane through its neighbours.
 *
 * @param {import("../capture/listing.js").Cloud} cloud
 * @param {import("./neighbour_search.js").Neighbourhoods} around
 * @param {{opacity: number, seed_size: number, coefficients: number}} recipe
 * @param {{thickness: number}} seeding
 * @returns {GaussianColumns}
 */
export function seedDiscs({ positions, colours }, { spacing, normals, tangents }, recipe, { thickness }) {
    const count = positions.length / 3;
    const scene = new GaussianColumns(count, recipe.coefficients);
    // Points that nearly coincide would give Gaussians of size zero.
    const least = 0.01 * medianOf(spacing) + 1.1754944e-38;
    for (let i = 0; i < count; i++) {
        const size = recipe.seed_size * Math.max(spacing[i], least);
        const [normal, tangent] = [normals, tangents].map((axes) => [...axes.subarray(3 * i, 3 * i + 3)]);
        const quaternion = rotationTo([tangent, cross(normal, tangent), normal]);
        quaternion.forEach((value, part) => (scene.column(QUATERNION + part)[i] = value));
        [1, 1, thickness].forEach((share, axis) => {
            scene.column(MEAN + axis)[i] = positions[3 * i + axis];
            scene.column(LOG_SCALE + axis)[i] = Math.log(size * share);
            scene.harmonics(0, axis)[i] = dcOf(colours[3 * i + axis]);
        });
    }
    scene.column(OPACITY_LOGIT).fill(Math.log(recipe.opacity / (1 - recipe.opacity)));
    return scene;
}
