/**
 * Fusion of the keyframes' depth maps: which pixels are consistent; the twin of `prior/cloud/fuse.py`.
 *
 * @module
 */

import { centreOf, rayOf } from "../capture/camera.js";
import { medianOf } from "../numbers/quantiles.js";
import { meanOf } from "../seeding/focus.js";
import { outsideHull } from "../seeding/visual_hull.js";
import { add, dot, length, normalised, subtract } from "../../page/scene/vectors.js";
import { Candidates } from "./candidates.js";
import { detailOf } from "./detail.js";
import { frameWithin } from "./photographs.js";

/**
 * @typedef {import("../capture/photograph.js").Frame} Frame
 * @typedef {import("./comparison_inputs.js").View} View
 *
 * @typedef {{centre: number[], radius: number}} Shell the sphere for points too distant to have a measurable depth
 */

/**
 * Fuse pixels that other keyframes confirm, and in the holes between them those that none contradicts.
 *
 * @param {Frame[]} keyframes
 * @param {View[]} views of the keyframes
 * @param {Frame[]} frames to train on, whose transparency bounds the cloud
 * @param {Object} settings the settings' `fusion`
 * @param {import("./stereo.js").Stereo} stereo compares the depth maps
 * @returns {Promise<Candidates>}
 */
export async function fuse(keyframes, views, frames, settings, stereo) {
    const shell = farShell(views, settings);
    const known = views.reduce((sum, { map }) => sum + map.depth.reduce((count, depth) => count + (depth !== 0), 0), 0);
    const pixels = views.reduce((sum, { map }) => sum + map.depth.length, 0);
    const stride = Math.max(1, Math.ceil(known / mostCandidates(pixels, settings)));
    const candidates = new Candidates(Math.ceil(known / stride) + views.length);
    let view = 0;
    for await (const confirmed of stereo.compare(views, settings)) {
        const { camera } = views[view];
        const keyframe = frameWithin(keyframes[view], camera.width * camera.height);
        addBelieved(candidates, keyframe, views[view].map, confirmed, stride, shell, settings);
        view++;
    }
    const found = candidates.positions.subarray(0, 3 * candidates.count);
    candidates.drop(outsideHull(found, frames, settings.judging_points));
    return candidates;
}

/** Maximum number of pixels to merge: of every so many one, if all of them had depth. */
function mostCandidates(pixels, settings) {
    return Math.ceil(pixels / Math.ceil(pixels / settings.max_candidates));
}

/** Add a keyframe's pixels with confidence, or every so many of them. */
function addBelieved(candidates, keyframe, map, { confidences, footprints }, stride, shell, settings) {
    const { camera, rgba } = keyframe;
    const [centre, details] = [centreOf(camera), detailOf(keyframe, settings.detail_scale)];
    let found = 0;
    for (let i = 0; i < confidences.length; i++) {
        if (!confidences[i] || found++ % stride) {
            continue;
        }
        const ray = rayOf(camera, (i % camera.width) + 0.5, Math.floor(i / camera.width) + 0.5);
        const isResolved = map.depth[i] <= 1 / map.step;
        const depth = isResolved ? map.depth[i] : depthOnShell(centre, ray, shell);
        const position = add(centre, ray, depth);
        const colour = [0, 1, 2].map((channel) => rgba[4 * i + channel] / 255);
        const away = normalised(ray).map((value) => -value);
        const footprint = isResolved ? footprints[i] : depth / camera.fx;
        candidates.add(position, colour, away, footprint, details[i], confidences[i]);
    }
}

/** @type {(views: View[], settings: Object) => Shell} */
function farShell(views, settings) {
    const centres = views.map(({ camera }) => centreOf(camera));
    const centre = meanOf(centres);
    const extent = Math.max(...centres.map((one) => length(subtract(one, centre))));
    const resolved = medianOf(views.map(({ map }) => 1 / map.step));
    return { centre, radius: Math.max(resolved, settings.shell_extent * extent) };
}

/** By what a ray from a point inside the shell has to be multiplied so that it ends on it. */
function depthOnShell(origin, ray, { centre, radius }) {
    const offset = subtract(origin, centre);
    const [square, half] = [dot(ray, ray), dot(ray, offset)];
    return (Math.sqrt(half ** 2 + square * (radius ** 2 - dot(offset, offset))) - half) / square;
}
