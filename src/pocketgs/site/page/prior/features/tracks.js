/**
 * Tracks: matches between pairs of views, linked across views and triangulated; the twin of `prior/features/tracks.py`.
 *
 * @module
 */

import { centreOf, projected, rayOf } from "../../capture/camera.js";
import { factorise, substitute } from "../../numbers/cholesky.js";
import { dot, normalised } from "../../../page/scene/vectors.js";
import { pointsOf } from "./observations.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("./finder.js").Features} Features
 * @typedef {import("./observations.js").Observations} Observations
 *
 * @typedef {Object} Matches of two views
 * @property {number} first
 * @property {number} second
 * @property {Int32Array} pairs (M, 2) numbers of features
 */

/** Below it, of the determinant in units of the cube of the trace, the rays of a point are parallel. */
const DEGENERATE = 1e-13;

/**
 * Positions of matched features in either view.
 *
 * @param {Features[]} features
 * @param {Matches} matches
 * @returns {[Float64Array, Float64Array]} (M, 2) pixels each
 */
export function positionsOf(features, { first, second, pairs }) {
    return [first, second].map((view, side) => {
        const { pixels } = features[view];
        return Float64Array.from({ length: pairs.length }, (_, i) => pixels[2 * pairs[i - (i % 2) + side] + (i % 2)]);
    });
}

/**
 * Link matches into tracks: connected features are observations of the same point. A track with two features in one
 * view is dropped: one of its matches is wrong.
 *
 * @param {Features[]} features
 * @param {Matches[]} matches
 * @returns {{tracks: Observations, feature: Int32Array}} sorted by point and frame; the index of each in its frame
 */
export function link(features, matches) {
    const starts = [0];
    features.forEach(({ count }) => starts.push(starts.at(-1) + count));
    const parents = Int32Array.from({ length: starts.at(-1) }, (_, i) => i);
    const used = new Set();
    for (const { first, second, pairs } of matches) {
        for (let i = 0; i < pairs.length; i += 2) {
            const [one, other] = [starts[first] + pairs[i], starts[second] + pairs[i + 1]];
            used.add(one).add(other);
            join(parents, one, other);
        }
    }
    const frameOf = features.flatMap(({ count }, frame) => new Array(count).fill(frame));
    const sightings = [...used].map((at) => ({ at, track: rootOf(parents, at), frame: frameOf[at] }));
    sightings.sort((a, b) => a.track - b.track || a.frame - b.frame);
    const clash = ({ track, frame }, other) => other && other.track === track && other.frame === frame;
    const wrong = new Set(sightings.filter((one, i) => clash(one, sightings[i + 1])).map(({ track }) => track));
    return observed(sightings.filter(({ track }) => !wrong.has(track)), features, starts);
}

function observed(sightings, features, starts) {
    const size = sightings.length;
    const tracks = { frame: new Int32Array(size), point: new Int32Array(size), pixels: new Float64Array(2 * size) };
    const feature = new Int32Array(size);
    sightings.forEach(({ at, track, frame }, i) => {
        feature[i] = at - starts[frame];
        tracks.frame[i] = frame;
        tracks.point[i] = i ? tracks.point[i - 1] + Number(track !== sightings[i - 1].track) : 0;
        tracks.pixels.set(features[frame].pixels.subarray(2 * feature[i], 2 * feature[i] + 2), 2 * i);
    });
    return { tracks, feature };
}

/** The smallest index that is connected, with paths halved on the way. */
function rootOf(parents, at) {
    while (parents[at] !== at) {
        parents[at] = parents[parents[at]];
        at = parents[at];
    }
    return at;
}

function join(parents, one, other) {
    const [a, b] = [rootOf(parents, one), rootOf(parents, other)];
    parents[Math.max(a, b)] = Math.min(a, b);
}

/**
 * Least-squares intersections of rays, weighted to minimise errors in pixels. Weights are updated a few times so that
 * wrong rays lose influence. Points with parallel rays are not finite.
 *
 * @param {Camera[]} cameras
 * @param {Observations} observations
 * @param {{reweightings: number}} settings the settings' `poses`
 * @returns {Float64Array} (N, 3)
 */
export function triangulate(cameras, observations, { reweightings }) {
    const count = pointsOf(observations);
    const centres = cameras.map(centreOf);
    const rays = raysOf(cameras, observations);
    const weights = new Float64Array(observations.frame.length).fill(1);
    const points = new Float64Array(3 * count);
    for (let round = 0; round < reweightings; round++) {
        const [normals, rights] = [new Float64Array(9 * count), new Float64Array(3 * count)];
        observations.frame.forEach((frame, i) => {
            const at = observations.point[i];
            addRay(normals, rights, at, centres[frame], rays.subarray(3 * i, 3 * i + 3), weights[i]);
        });
        for (let point = 0; point < count; point++) {
            const normal = normals.subarray(9 * point, 9 * point + 9);
            points.set(solved(normal, rights.subarray(3 * point, 3 * point + 3)), 3 * point);
        }
        observations.frame.forEach((frame, i) => {
            const { fx, fy } = cameras[frame];
            const ray = rays.subarray(3 * i, 3 * i + 3);
            weights[i] = weightOf(points, observations.point[i], centres[frame], ray, Math.sqrt(fx * fy));
        });
    }
    return points;
}

/** (M, 3) unit directions of the observations' rays. */
function raysOf(cameras, { frame, pixels }) {
    const rays = new Float64Array(3 * frame.length);
    frame.forEach((view, i) => rays.set(normalised(rayOf(cameras[view], pixels[2 * i], pixels[2 * i + 1])), 3 * i));
    return rays;
}

/** Add the normal equations of the distance from a ray, of which only the part across it counts. */
function addRay(normals, rights, point, centre, ray, weight) {
    for (let row = 0; row < 3; row++) {
        for (let column = 0; column < 3; column++) {
            const across = weight * (Number(row === column) - ray[row] * ray[column]);
            normals[9 * point + 3 * row + column] += across;
            rights[3 * point + row] += across * centre[column];
        }
    }
}

function solved(m, right) {
    const trace = m[0] + m[4] + m[8];
    const determinant = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6])
        + m[2] * (m[3] * m[7] - m[4] * m[6]);
    if (!(determinant > DEGENERATE * trace ** 3) || !factorise(m, 3)) {
        return [NaN, NaN, NaN];
    }
    substitute(m, right);
    return right;
}

function weightOf(points, point, centre, ray, focal) {
    const offset = centre.map((value, axis) => points[3 * point + axis] - value);
    const distance = Math.max(Math.hypot(...offset), 1e-12);
    const along = dot(offset, ray);
    const missed = (Math.hypot(...offset.map((value, axis) => value - along * ray[axis])) * focal) / distance;
    return (focal / distance) ** 2 / (1 + missed ** 2) || 0;
}

/**
 * Reprojection errors in pixels; infinite behind the camera.
 *
 * @param {Camera[]} cameras
 * @param {Float64Array} points (N, 3)
 * @param {Observations} observations
 * @returns {Float64Array} (M,)
 */
export function reprojectionErrors(cameras, points, { frame, point, pixels }) {
    return Float64Array.from(frame, (view, i) => {
        const at = 3 * point[i];
        const [x, y, depth] = projected(cameras[view], points[at], points[at + 1], points[at + 2]);
        return depth > 0 ? Math.hypot(x - pixels[2 * i], y - pixels[2 * i + 1]) : Infinity;
    });
}

/**
 * Angles that the rays of points span: twice the largest angle to their mean, a close approximation.
 *
 * @param {Camera[]} cameras
 * @param {Float64Array} points (N, 3)
 * @param {Observations} observations
 * @returns {Float64Array} (N,) in radians
 */
export function triangulationAngles(cameras, points, { frame, point }) {
    const centres = cameras.map(centreOf);
    const offsets = Array.from(frame, (view, i) => centres[view].map((c, axis) => points[3 * point[i] + axis] - c));
    const directions = offsets.map(normalised);
    const means = new Float64Array(points.length);
    directions.forEach((direction, i) => direction.forEach((value, axis) => (means[3 * point[i] + axis] += value)));
    const angles = new Float64Array(points.length / 3);
    directions.forEach((direction, i) => {
        const cosine = dot(direction, normalised(means.subarray(3 * point[i], 3 * point[i] + 3)));
        angles[point[i]] = Math.max(angles[point[i]], 2 * Math.acos(Math.min(Math.max(cosine, -1), 1)));
    });
    return angles;
}
