/**
 * The poses from which a camera sees three points where it does (P3P).
 *
 * @module
 */

import { rootsBetween } from "../../numbers/roots.js";
import { product, transposed } from "../../numbers/rotations.js";
import { cross, dot, length, normalised, subtract } from "../../../page/scene/vectors.js";

/** @typedef {import("../../../page/scene/vectors.js").Vector} Vector */

/** Points whose distances from the camera differ by a larger factor do not count. */
const LARGEST_RATIO = 1000;

/** Three points are on a line if one is nearer to that through the others than this share of a side. */
const FLAT = 1e-6;

/**
 * Up to four poses, by Grunert's quartic equation (Haralick et al., "Review and analysis of solutions of the three point
 * perspective pose estimation problem", 1994, equation 9).
 *
 * @param {Vector[]} points three in the world
 * @param {Vector[]} rays unit vectors to them in the camera's axes
 * @returns {number[][]} world to camera, 4 x 4 row by row; none for points on a line
 */
export function posesOfThree(points, rays) {
    const axes = axesOf(points);
    return axes ? distancesOf(points, rays).map((distances) => poseOf(points, axes, rays, distances)) : [];
}

/** Distances of the points from the camera: by the law of cosines in the three triangles with it as a corner. */
function distancesOf([first, second, third], rays) {
    const square = (one, other) => dot(subtract(one, other), subtract(one, other));
    const [aa, bb, cc] = [square(second, third), square(first, third), square(first, second)];
    const [alpha, beta, gamma] = [dot(rays[1], rays[2]), dot(rays[0], rays[2]), dot(rays[0], rays[1])];
    const [difference, sum, a, c] = [(aa - cc) / bb, (aa + cc) / bb, aa / bb, cc / bb];
    const quartic = [
        (1 + difference) ** 2 - 4 * a * gamma ** 2,
        4 * (-difference * (1 + difference) * beta + 2 * a * gamma ** 2 * beta - (1 - sum) * alpha * gamma),
        2 * (difference ** 2 - 1 + 2 * difference ** 2 * beta ** 2 + 2 * (1 - c) * alpha ** 2
            - 4 * sum * alpha * beta * gamma + 2 * (1 - a) * gamma ** 2),
        4 * (difference * (1 - difference) * beta - (1 - sum) * alpha * gamma + 2 * c * alpha ** 2 * beta),
        (difference - 1) ** 2 - 4 * c * alpha ** 2,
    ];
    // The third point's distance in units of the first one's, from which follow the second one's and the unit.
    return rootsBetween(quartic, 1 / LARGEST_RATIO, LARGEST_RATIO).flatMap((v) => {
        const u = ((difference - 1) * v ** 2 - 2 * difference * beta * v + 1 + difference) / (2 * (gamma - v * alpha));
        const unit = Math.sqrt(bb / (1 + v ** 2 - 2 * v * beta));
        return u > 0 && u < Infinity ? [[unit, u * unit, v * unit]] : [];
    });
}

/** The pose that takes points with such axes to such distances along the rays. */
function poseOf(points, axes, rays, distances) {
    const seen = rays.map((ray, i) => ray.map((value) => distances[i] * value));
    const rotation = product(transposed(axesOf(seen)), axes);
    const rows = [0, 1, 2].map((row) => rotation.slice(3 * row, 3 * row + 3));
    return [...rows.flatMap((own, row) => [...own, seen[0][row] - dot(own, points[0])]), 0, 0, 0, 1];
}

/** The axes that three points span, row by row: along a side, across it, and along the normal; null for a line. */
function axesOf([first, second, third]) {
    const along = normalised(subtract(second, first));
    const side = subtract(third, first);
    const normal = cross(along, side);
    if (!(length(normal) > FLAT * length(side))) {
        return null;
    }
    const up = normalised(normal);
    return [...along, ...cross(up, along), ...up];
}
