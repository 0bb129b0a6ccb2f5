/**
 * Whether views see enough points, well enough spread, to determine their poses; the twin of `prior/poses/support.py`.
 *
 * @module
 */

import { countsOf } from "../features/observations.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 */

/**
 * @param {Camera[]} cameras
 * @param {Observations} observations in their views
 * @param {number} fewest minimum number of observations of a view
 * @param {{cells: number, min_cells: number}} settings the settings' `poses`
 * @returns {boolean[]} for each camera
 */
export function wellSupported(cameras, { frame, pixels }, fewest, { cells, min_cells: fewestCells }) {
    const occupied = cameras.map(() => new Set());
    frame.forEach((view, i) => {
        const { width, height } = cameras[view];
        const [across, down] = [pixels[2 * i] / width, pixels[2 * i + 1] / height].map((share) => {
            return Math.trunc(Math.min(Math.max(share * cells, 0), cells - 1));
        });
        occupied[view].add(cells * down + across);
    });
    const counts = countsOf(frame, cameras.length);
    return cameras.map((_, view) => counts[view] >= fewest && occupied[view].size >= fewestCells);
}
