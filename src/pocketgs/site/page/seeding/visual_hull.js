/**
 * The visual hull of the silhouettes in transparent images; the twin of `prior/cloud/visual_hull.py`, but photographs
 * that lost the object when they were cut out are not left out here.
 *
 * @module
 */

import { isInImage, projected } from "../capture/camera.js";

/**
 * The frames that have silhouettes.
 *
 * @param {import("../capture/photograph.js").Frame[]} frames
 * @returns {import("../capture/photograph.js").Frame[]}
 */
export const transparentOnes = (frames) => frames.filter(({ hasAlpha }) => hasAlpha);

/**
 * Whether a point projects to a transparent pixel of some image.
 *
 * @param {number} x
 * @param {number} y
 * @param {number} z
 * @param {import("../capture/photograph.js").Frame[]} frames from `transparentOnes`
 * @returns {boolean}
 */
export function isOutsideHull(x, y, z, frames) {
    return frames.some(({ camera, rgba }) => {
        const place = projected(camera, x, y, z);
        if (!isInImage(camera, place)) {
            return false;
        }
        const [column, row] = place.map(Math.floor);
        return rgba[4 * (row * camera.width + column) + 3] === 0;
    });
}
