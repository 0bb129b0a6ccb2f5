/**
 * Poses that are wrong as a whole, since their file follows another convention than it says; the twin of
 * `prior/poses/convention.py`.
 *
 * @module
 */

import { centreOf } from "../../capture/camera.js";
import { positionsOf } from "../features/tracks.js";
import { errorOf, meetingOf, sightingOf } from "./consensus.js";
import { widestTolerance } from "./tolerance.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 *
 * @typedef {Object} Convention another way to read a pose
 * @property {number[]} order which of the stated camera axes the right ones are
 * @property {number[]} signs of these
 * @property {boolean} isInverted whether the stated transform is the inverse of world-to-camera
 */

const AXES = [0, 1, 2];
const EVEN = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];
const ODD = [[0, 2, 1], [1, 0, 2], [2, 1, 0]];

/** The photographs fit the poses only in another convention. */
export class MisreadPoses extends Error {
    /** @param {Convention} convention that fits */
    constructor(convention) {
        super(`The photographs fit the poses only with ${nameOf(convention)}`);
        this.convention = convention;
    }
}

/** The camera with its pose read in another way. @type {(camera: Camera, convention: Convention) => Camera} */
export function readIn(camera, { order, signs, isInverted }) {
    const m = camera.world_to_camera;
    const centre = centreOf(camera);
    const stated = isInverted ? AXES.flatMap((i) => [m[i], m[4 + i], m[8 + i], centre[i]]) : m;
    const rows = order.flatMap((axis, i) => stated.slice(4 * axis, 4 * axis + 4).map((value) => signs[i] * value));
    return { ...camera, world_to_camera: [...rows, 0, 0, 0, 1] };
}

/**
 * How far matches fit the given poses.
 *
 * @typedef {Object} Agreement
 * @property {number} share of the matches
 * @property {number} matches their number
 */

/**
 * Check that the matches do not contradict the poses as a whole.
 *
 * @param {Camera[]} cameras
 * @param {import("../features/finder.js").Features[]} features of their views
 * @param {import("../features/tracks.js").Matches[]} matches verified without poses
 * @param {Object} settings the settings' `poses`
 * @returns {Agreement} its share is 1 if there are too few matches for a conclusion
 * @throws {MisreadPoses | Error} they fit in no convention
 */
export function checkConvention(cameras, features, matches, settings) {
    const { doubtful, clear, contradicted, min_matches: fewest } = settings.convention;
    const [seen, found] = [withPixels(features, matches), countOf(matches)];
    const tolerance = widestTolerance(cameras, settings);
    const given = { share: found < fewest ? 1 : shareOf(cameras, seen, tolerance), matches: found };
    if (given.share >= doubtful) {
        return given;
    }
    const readAs = (one) => cameras.map((camera) => readIn(camera, one));
    const others = conventions().map((one) => [one, shareOf(readAs(one), seen, tolerance)]);
    const [best, most] = others.reduce((best, one) => (one[1] > best[1] ? one : best));
    if (most >= clear) {
        throw new MisreadPoses(best);
    }
    if (given.share < contradicted) {
        throw contradiction(given);
    }
    return given;
}

/**
 * Check that poses which most matches contradicted fit them once they are adjusted.
 *
 * @param {Agreement} given from `checkConvention`
 * @param {Camera[] | null} cameras adjusted; null if too few points agree on them
 * @param {import("../features/finder.js").Features[]} features of their views
 * @param {import("../features/tracks.js").Matches[]} matches of the views whose poses are used
 * @param {Object} settings the settings' `poses`
 * @throws {Error} they do not fit
 */
export function checkAdjusted(given, cameras, features, matches, settings) {
    const { mostly, mended, min_matches: fewest } = settings.convention;
    if (given.share >= mostly || countOf(matches) < fewest) {
        return;
    }
    const seen = withPixels(features, matches);
    if (cameras === null || shareOf(cameras, seen, widestTolerance(cameras, settings)) < mended) {
        throw contradiction(given);
    }
}

/** Matches with the pixels of their features. */
function withPixels(features, matches) {
    return matches.map((some) => ({ ...some, pixels: positionsOf(features, some) }));
}

function countOf(matches) {
    return matches.reduce((sum, { pairs }) => sum + pairs.length / 2, 0);
}

/** The share of the matches, with pixels, that fits the poses. */
function shareOf(cameras, seen, tolerance) {
    return seen.reduce((sum, one) => sum + fitting(cameras, one, tolerance), 0) / countOf(seen);
}

function contradiction({ share, matches }) {
    const part = `${Math.round(100 * (1 - share))} % of ${matches} matches`;
    return new Error(
        `The photographs match each other, but ${part} contradict the capture's poses: are poses and focal ` +
            "lengths those of these photographs? Expected poses that fit them",
    );
}

/** All conventions but the stated one: 24 ways to name the axes, each as it is and inverted. */
function conventions() {
    const signs = Array.from({ length: 8 }, (_, bits) => AXES.map((axis) => ((bits >> (2 - axis)) & 1 ? -1 : 1)));
    const product = ([a, b, c]) => a * b * c;
    const named = [[EVEN, 1], [ODD, -1]].flatMap(([orders, parity]) => {
        const fitting = signs.filter((some) => product(some) === parity);
        return orders.flatMap((order) => fitting.map((some) => ({ order, signs: some })));
    });
    const all = named.flatMap((one) => [false, true].map((isInverted) => ({ ...one, isInverted })));
    return all.slice(1); // the first is the stated one
}

function nameOf({ order, signs, isInverted }) {
    const names = order.map((axis, i) => (signs[i] < 0 ? "-" : "") + "xyz"[axis]).join(", ");
    const axes = `camera axes (${names}) in place of (x, y, z)`;
    const known = { "x, y, z": null, "x, -y, -z": "OpenGL's camera axes in place of OpenCV's, or the reverse" };
    const turned = names in known ? known[names] : axes;
    return [turned, isInverted ? "inverted transforms" : null].filter(Boolean).join(" and ");
}

/** How many of a pair's matches fit the poses. */
function fitting(cameras, { first, second, pixels: [here, there] }, tolerance) {
    const [one, other] = [cameras[first], cameras[second]];
    const [centre, away] = [centreOf(one), centreOf(other)];
    let count = 0;
    for (let i = 0; i < here.length; i += 2) {
        const left = sightingOf(one, centre, here[i], here[i + 1]);
        count += fits(left, sightingOf(other, away, there[i], there[i + 1]), tolerance);
    }
    return count;
}

/** Whether some point in front of both cameras, or at infinity, is near both sightings. */
function fits(one, other, tolerance) {
    const atInfinity = other.centre.map((value, i) => value + one.ray[i]);
    if (errorOf(other, atInfinity) < tolerance) {
        return true;
    }
    const point = meetingOf(one, other, 1);
    return point !== null && errorOf(one, point) < tolerance && errorOf(other, point) < tolerance;
}
