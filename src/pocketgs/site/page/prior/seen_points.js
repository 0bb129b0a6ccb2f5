/**
 * Which points of a cloud the frames see, where no features say so; the twin of `prior/seen_points.py`.
 *
 * @module
 */

import { evenlyChosen } from "../numbers/evenly.js";
import { selected } from "../seeding/points.js";
import { placeIn, pointRadii } from "./coverage.js";

/**
 * For each frame the points of a cloud that it sees: in the image, not transparent there, and not occluded.
 *
 * @param {import("../capture/listing.js").Cloud} cloud
 * @param {import("./coverage.js").ViewCells} views of the frames
 * @param {Object} settings the settings' `coverage` and `seen_points`
 * @returns {Float64Array[]} (N, 3) positions
 */
export function seenPoints(cloud, views, { coverage, seen_points: { max_points: most, max_seen: each, hidden } }) {
    const some = selected(cloud, evenlyChosen(cloud.positions.length / 3, most));
    const { positions } = some;
    const nearest = views.empty();
    views.cover(nearest, some, pointRadii(positions, coverage.neighbours));
    return views.grids.map((grid, view) => {
        const seen = [];
        for (let i = 0; i < positions.length / 3; i++) {
            const { cell, depth } = placeIn(grid, positions, i);
            if (cell >= 0 && grid.usable[cell] && depth < hidden * nearest[view][cell]) {
                seen.push(i);
            }
        }
        return selected({ positions }, evenlyChosen(seen.length, each).map((i) => seen[i])).positions;
    });
}
