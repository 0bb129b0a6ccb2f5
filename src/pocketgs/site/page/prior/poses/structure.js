/**
 * Sparse structure of a capture: triangulated points and refined poses; the twin of
 * `prior/poses/structure.py`.
 *
 * @module
 */

import { centreOf } from "../../capture/camera.js";
import { medianOf } from "../../numbers/quantiles.js";
import { likeness } from "../features/appearance.js";
import { countsOf, filtered, indicesWhere, renumbered, selected } from "../features/observations.js";
import { choosePairs } from "../features/pairs.js";
import { link, reprojectionErrors, triangulate, triangulationAngles } from "../features/tracks.js";
import { matchViews } from "../features/two_view.js";
import { consensus } from "./consensus.js";
import { checkAdjusted, checkConvention } from "./convention.js";
import { normalised, subtract } from "../../../page/scene/vectors.js";
import { refine } from "./refinement.js";
import { Relocalisation } from "./relocalisation.js";
import { contradicted, unmatchedViews } from "./suspects.js";
import { measuredTolerance, widestTolerance } from "./tolerance.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../../capture/photograph.js").Frame} Frame
 * @typedef {import("../features/finder.js").Features} Features
 * @typedef {import("../features/observations.js").Observations} Observations
 *
 * @typedef {Object} Structure
 * @property {Camera[]} cameras of the frames; the given ones, the same objects, where they are not refined
 * @property {Float64Array} points (N, 3)
 * @property {Observations} observations of the points
 * @property {boolean} isAdjusted whether adjustment has moved cameras together, so that points of the given world no
 *     longer fit them
 *
 * @typedef {Object} Contradicted
 * @property {boolean[]} replaced for each camera whether its given pose was wrong and it was relocalised
 * @property {boolean[]} unplaced for each camera whether the others contradict its pose and it could not be relocalised
 */

/**
 * Triangulate points that several frames see, and refine the poses where the points contradict them.
 *
 * @param {Frame[]} frames with given poses, including held-out ones: only geometry is used
 * @param {import("../scale.js").Scale} scale
 * @param {Object} settings the settings' `pairs`, `two_view`, `suspects` and `poses`
 * @param {import("../features/finder.js").FeatureFinder} finder
 * @param {(text: string, share: number) => Promise<void>} onStage called before each piece of work; rejects to stop
 * @returns {Promise<(Structure & Contradicted) | null>} null if there is too little texture
 * @throws {MisreadPoses | Error} the frames contradict their poses as a whole, see `checkConvention`
 */
export async function buildStructure(frames, scale, settings, finder, onStage) {
    const given = frames.map(({ camera }) => camera);
    const features = await finder.detect(frames, (done) => {
        return onStage(`features of photograph ${done + 1} of ${frames.length}`, done / frames.length);
    });
    const words = await finder.words(settings.pairs.words, (done) => {
        return onStage(`comparing photograph ${done + 1} of ${frames.length}`, done / frames.length);
    });
    const alike = likeness(words, settings.pairs.words);
    const pairs = choosePairs(frames.map(({ name }) => name), given, alike, scale.distance, settings.pairs);
    const matching = (text) => (cameras, some) => {
        return matchViews(cameras, features, some, finder, settings.two_view, (done, of) => {
            return onStage(`${text} ${done + 1} of ${of}`, done / of);
        });
    };
    const matches = await matching("matching pair")(given, pairs);
    const agreement = checkConvention(given, features, matches, settings.poses);
    const finest = settings.poses.finest * medianOf(features.map(({ grain }) => grain));
    const matchAnew = matching("placing photographs anew, pair");
    const placed = await placedAnew({ given, features, matches, alike, finest }, scale, settings, matchAnew);
    await onStage("adjusting poses", 1);
    const { cameras, wrong: unplaced } = placed;
    const sound = placed.matches.filter(({ first, second }) => !unplaced[first] && !unplaced[second]);
    const structure = structureOf(cameras, frames, link(features, sound).tracks, scale, finest, settings.poses);
    checkAdjusted(agreement, structure?.cameras ?? null, features, sound, settings.poses);
    return structure && { ...structure, replaced: cameras.map((camera, i) => camera !== given[i]), unplaced };
}

/** Cameras, with wrong ones relocalised where possible; all matches; and which cameras remain wrong. */
async function placedAnew({ given, features, matches, alike, finest }, { distance }, settings, match) {
    const { tracks } = link(features, matches);
    const measured = measuredTolerance(given, tracks, finest, settings.poses);
    const tolerance = Math.max(settings.two_view.verification * finest, measured);
    // Drift accumulates along a walk: errors slightly above the usual do not contradict a pose.
    const gross = Math.max(tolerance, widestTolerance(given, settings.poses) / 2);
    const strange = unmatchedViews(given, features, matches, distance, settings.suspects);
    const against = contradicted(given, features, matches, gross, settings.suspects);
    const found = { cameras: given, matches, wrong: against.map((is, view) => is || strange[view]) };
    if (!found.wrong.some(Boolean)) {
        return found;
    }
    const relocalisation = new Relocalisation(found, { features, likeness: alike, tolerance, distance }, settings, match);
    await relocalisation.run();
    return relocalisation;
}

/**
 * The structure of tracks.
 *
 * @param {Camera[]} given
 * @param {Frame[]} frames of the cameras, whose photographs count
 * @param {Observations} tracks sorted by point, including wrong ones
 * @param {import("../scale.js").Scale} scale
 * @param {number} finest errors below this many pixels are noise
 * @param {Object} settings the settings' `poses`
 * @returns {Structure | null} null if there are too few points
 */
export function structureOf(given, frames, tracks, { distance, unit }, finest, settings) {
    const bundle = { ...settings.bundle, position_sigma: settings.bundle.position_sigma * unit };
    const widest = widestTolerance(given, settings);
    const cameras = refine(given, tracks, frames, widest, finest, { ...settings, bundle }, distance);
    const tolerance = measuredTolerance(cameras, tracks, finest, settings);
    const { points, observations } = agreedOn(cameras, tracks, tolerance, settings);
    const isAdjusted = cameras.some((camera, i) => camera !== given[i]);
    return points.length < 3 * settings.fewest_points ? null : { cameras, points, observations, isAdjusted };
}

/**
 * The structure of some frames: the points that at least two of them see, renumbered.
 *
 * @param {Structure} structure
 * @param {number[]} frames their indices, ascending
 * @returns {Structure}
 */
export function structureOfFrames({ cameras, points, observations, isAdjusted }, frames) {
    const places = new Map(frames.map((frame, place) => [frame, place]));
    const own = filtered(observations, (i) => places.has(observations.frame[i]));
    const inside = { ...own, frame: own.frame.map((frame) => places.get(frame)) };
    const views = countsOf(inside.point, points.length / 3);
    const kept = filtered(inside, (i) => views[inside.point[i]] >= 2);
    const chosen = indicesWhere(views.length, (point) => views[point] >= 2);
    return {
        cameras: frames.map((frame) => cameras[frame]),
        points: Float64Array.from(chosen.flatMap((point) => [...points.subarray(3 * point, 3 * point + 3)])),
        observations: renumbered(kept),
        isAdjusted,
    };
}

/** For each frame the points that it sees. @type {(structure: Structure) => Float64Array[]} (N, 3) each */
export function pointsSeen({ cameras, points, observations: { frame, point } }) {
    const seen = cameras.map(() => []);
    frame.forEach((view, i) => seen[view].push(...points.subarray(3 * point[i], 3 * point[i] + 3)));
    return seen.map((positions) => Float64Array.from(positions));
}

/**
 * The triangulated points, each with the colour of one of its features and the direction to that camera.
 *
 * @param {Frame[]} frames those of the structure
 * @param {Structure} structure
 * @returns {import("../../capture/listing.js").Cloud}
 */
export function sparseCloud(frames, { cameras, points, observations: { frame, point, pixels } }) {
    const [colours, directions] = [new Float32Array(points.length), new Float32Array(points.length)];
    const centres = cameras.map(centreOf);
    frame.forEach((view, i) => {
        const at = 3 * point[i];
        const [column, row] = pixels.subarray(2 * i, 2 * i + 2).map(Math.trunc);
        const { rgba, camera } = frames[view];
        const first = 4 * (row * camera.width + column);
        colours.set(Array.from(rgba.subarray(first, first + 3), (level) => level / 255), at);
        directions.set(normalised(subtract(centres[view], points.subarray(at, at + 3))), at);
    });
    return { positions: points, colours, directions };
}

/** The points that observations agree on, and those observations. */
function agreedOn(cameras, tracks, tolerance, settings) {
    const { agrees } = consensus(cameras, tracks, tolerance, settings);
    let seen = renumbered(filtered(tracks, (i) => agrees[i]));
    for (let round = 0; round < 2; round++) {
        const points = triangulate(cameras, seen, settings);
        const errors = reprojectionErrors(cameras, points, seen);
        const near = indicesWhere(errors.length, (i) => errors[i] < tolerance);
        const good = selected(seen, near);
        const views = countsOf(good.point, points.length / 3);
        const angles = triangulationAngles(cameras, points, good);
        const isSure = (point) => views[point] >= 2 && angles[point] >= settings.min_angle;
        seen = renumbered(filtered(good, (i) => isSure(good.point[i])));
    }
    return { points: triangulate(cameras, seen, settings), observations: seen };
}
