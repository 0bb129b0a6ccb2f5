/**
 * Consensus per track: the sightings that agree on a point under given poses, and the error of each against the rest;
 * the twin of `prior/poses/consensus.py`.
 *
 * @module
 */

import { centreOf, projected, rayOf } from "../../capture/camera.js";
import { startsOf } from "../features/observations.js";
import { dot, normalised, subtract } from "../../../page/scene/vectors.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 *
 * @typedef {Object} Consensus of M sightings
 * @property {Uint8Array} agrees is in the largest set of sightings within the tolerance of one point
 * @property {Int32Array} support sightings of the track that agree on a point triangulated without this one
 * @property {Float64Array} others (M, 3) that point; NaN where there is none
 * @property {Float64Array} error distance in pixels from that point's projection; infinite where there is none
 */

/**
 * Find the consensus of each track. As in RANSAC, points are triangulated from pairs of sightings, and the one that
 * most others agree with wins.
 *
 * @param {Camera[]} cameras
 * @param {Observations} tracks sorted by point
 * @param {number} tolerance distance in pixels within which a sighting agrees with a point
 * @param {{max_trials: number, min_angle: number}} settings the settings' `poses`
 * @returns {Consensus}
 */
export function consensus(cameras, tracks, tolerance, settings) {
    const size = tracks.frame.length;
    const found = {
        agrees: new Uint8Array(size),
        support: new Int32Array(size),
        others: new Float64Array(3 * size).fill(NaN),
        error: new Float64Array(size).fill(Infinity),
    };
    const centres = cameras.map(centreOf);
    const sightings = Array.from(tracks.frame, (frame, i) => {
        return sightingOf(cameras[frame], centres[frame], tracks.pixels[2 * i], tracks.pixels[2 * i + 1]);
    });
    const starts = startsOf(tracks);
    for (let track = 0; track + 1 < starts.length; track++) {
        const own = sightings.slice(starts[track], starts[track + 1]);
        voteOn(own, starts[track], tolerance, settings, found);
    }
    return found;
}

/** A place in the image of a camera, whose centre is known. */
export const sightingOf = (camera, centre, x, y) => ({ camera, centre, ray: normalised(rayOf(camera, x, y)), x, y });

function voteOn(sightings, first, tolerance, { max_trials: trials, min_angle: least }, found) {
    const count = sightings.length;
    const pairs = (count * (count - 1)) / 2;
    const costs = new Float64Array(count).fill(Infinity);
    let [most, leastCost] = [1, Infinity];
    for (let trial = 0; trial < Math.min(pairs, trials); trial++) {
        const [one, other] = pairOf(Math.floor((trial * pairs) / Math.min(pairs, trials)), count);
        const point = meetingOf(sightings[one], sightings[other], Math.cos(least));
        const errors = point && sightings.map((sighting) => errorOf(sighting, point));
        if (!point || errors[one] >= tolerance || errors[other] >= tolerance) {
            continue;
        }
        const near = errors.filter((error) => error < tolerance);
        const cost = near.reduce((sum, error) => sum + error ** 2, 0);
        if (near.length > most || (near.length === most && cost < leastCost)) {
            [most, leastCost] = [near.length, cost];
            errors.forEach((error, k) => (found.agrees[first + k] = Number(error < tolerance)));
        }
        errors.forEach((error, k) => {
            if (k === one || k === other) {
                return;
            }
            const agrees = error < tolerance;
            const [without, rest] = agrees ? [near.length - 1, cost - error ** 2] : [near.length, cost];
            const at = first + k;
            if (without > found.support[at] || (without === found.support[at] && rest < costs[k])) {
                [found.support[at], costs[k], found.error[at]] = [without, rest, error];
                found.others.set(point, 3 * at);
            }
        });
    }
}

/** The pair of `count` items with this number; pairs of neighbours come first. */
function pairOf(number, count) {
    let step = 1;
    while (number >= count - step) {
        number -= count - step;
        step += 1;
    }
    return [number, number + step];
}

/** The midpoint of two sightings' rays at their closest approach; null if they are parallel or diverge. */
export function meetingOf({ centre: p, ray: u }, { centre: q, ray: v }, largestCosine) {
    const cosine = dot(u, v);
    if (cosine > largestCosine) {
        return null;
    }
    const between = subtract(q, p);
    const [alongU, alongV] = [dot(u, between), dot(v, between)];
    const square = 1 - cosine * cosine;
    const [s, t] = [(alongU - cosine * alongV) / square, (cosine * alongU - alongV) / square];
    return s > 0 && t > 0 ? p.map((value, i) => 0.5 * (value + s * u[i] + q[i] + t * v[i])) : null;
}

/** How many pixels a point's projection is off; infinite behind the camera. */
export function errorOf({ camera, x, y }, point) {
    const [column, row, depth] = projected(camera, ...point);
    return depth > 0 ? Math.hypot(column - x, row - y) : Infinity;
}
