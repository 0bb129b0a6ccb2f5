/**
 * The points that training starts from; the twin of `starting_points` in `training/preparation.py`, for `--prior none`.
 *
 * @module
 */

import { Generator } from "../random/generator.js";
import { drawPoints } from "./volume.js";

/**
 * The capture's own points, or random ones where the photographs agree if it has none.
 *
 * @param {import("../capture/open.js").Capture} capture
 * @param {number} most
 * @param {number} seed
 * @param {Object} settings
 * @returns {import("../capture/listing.js").Cloud}
 * @throws {Error} no volume is seen by several cameras
 */
export function startingPoints({ train, cloud }, most, seed, settings) {
    if (!cloud || cloud.positions.length / 3 < settings.volume.min_points) {
        return drawPoints(train, most, seed, settings.volume);
    }
    const count = cloud.positions.length / 3;
    if (count <= most) {
        return cloud;
    }
    return selected(cloud, new Generator(seed).permutation(count).slice(0, most).sort());
}

/**
 * Some of the points.
 *
 * @param {import("../capture/listing.js").Cloud} cloud
 * @param {ArrayLike<number>} indices
 * @returns {import("../capture/listing.js").Cloud}
 */
export function selected(cloud, indices) {
    const chosen = Object.entries(cloud).map(([name, values]) => {
        const found = new values.constructor(3 * indices.length);
        for (let i = 0; i < indices.length; i++) {
            for (let axis = 0; axis < 3; axis++) {
                found[3 * i + axis] = values[3 * indices[i] + axis];
            }
        }
        return [name, found];
    });
    return Object.fromEntries(chosen);
}
