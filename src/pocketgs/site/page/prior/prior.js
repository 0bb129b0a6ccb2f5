/**
 * The geometry prior: from photographs with poses to a dense cloud; the twin of `build_prior` in `prior/prior.py` for
 * poses that stay as given. Which points the frames see comes from the capture's own cloud, or from sweeps of small
 * copies, as long as nothing here finds features.
 *
 * @module
 */

import { completion, joined } from "./complete.js";
import { ViewCells } from "./coverage.js";
import { depthMap, sweptPixels } from "./depth_maps.js";
import { fuse } from "./fuse.js";
import { selectKeyframes } from "./keyframes.js";
import { merged } from "./merge.js";
import { cameraWithin } from "./photographs.js";
import { roughPoints } from "./rough_points.js";
import { typicalDistance } from "./scale.js";
import { seenPoints } from "./seen_points.js";

/**
 * @typedef {import("../capture/open.js").Capture} Capture
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 *
 * @typedef {Object} Listener
 * @property {(text: string, share: number) => Promise<void>} onStage called before each piece of work; rejects to stop
 */

/**
 * @param {Capture} capture
 * @param {number} most maximum size of the cloud
 * @param {Object} settings
 * @param {import("./stereo.js").Stereo} stereo
 * @param {Listener} listener
 * @returns {Promise<{cloud: Cloud, covered: number, keyframes: number}>} covered: share of the training pixels
 * @throws {NoRoom} the GPU's memory does not hold it
 */
export async function buildPrior({ train, cloud: own, isMetric }, most, settings, stereo, { onStage }) {
    const { prior } = settings;
    await onStage("choosing keyframes", 0);
    const distance = typicalDistance(train.map(({ camera }) => camera), isMetric, settings);
    const views = new ViewCells(train, prior.coverage);
    const points = await pointsSeen(own, train, views, distance, prior, stereo, onStage);
    const chosen = selectKeyframes(train, points, distance, prior.keyframes);
    const candidates = await swept(chosen, train, points, distance, prior, stereo, onStage);
    await onStage("merging depth maps", 1);
    let fused = merged(candidates, most, prior.merging);
    await onStage("filling holes", 1);
    const { added, covered } = completion(fused, views, own, distance, most, prior.coverage);
    const rest = most - added.positions.length / 3;
    if (fused.positions.length / 3 > rest) {
        fused = merged(candidates, rest, prior.merging);
    }
    return { cloud: joined([fused, added]), covered, keyframes: chosen.length };
}

/** For each frame the points that it sees: of the capture's own cloud, or rough ones. */
async function pointsSeen(own, frames, views, distance, settings, stereo, onStage) {
    const seen = own ? seenPoints(own, views, settings) : [];
    if (seen.some(({ length }) => length > 0)) {
        return seen;
    }
    return roughPoints(frames, distance, settings, stereo, (done) => {
        return onStage(`rough depth of photograph ${done + 1} of ${frames.length}`, done / frames.length);
    });
}

/** The consistent pixels of all keyframes' depth maps. The GPU's memory is free again afterwards. */
async function swept(chosen, frames, points, distance, settings, stereo, onStage) {
    const size = sweptPixels(chosen.length, settings.sweep);
    try {
        await stereo.reserve(frames.map(({ camera }) => cameraWithin(camera, size)), chosen.length).catch(refused);
        const views = [];
        for (const [done, index] of chosen.entries()) {
            await onStage(`depth of keyframe ${done + 1} of ${chosen.length}`, done / chosen.length);
            const map = await depthMap(index, frames, points[index], distance, size, settings, stereo);
            views.push({ camera: cameraWithin(frames[index].camera, size), map });
        }
        await onStage("comparing depth maps", 1);
        return await fuse(chosen.map((index) => frames[index]), views, frames, settings.fusion, stereo);
    } finally {
        stereo.release();
    }
}

/** The GPU's memory does not hold what depth takes. */
export class NoRoom extends Error {}

function refused({ message }) {
    throw new NoRoom(message);
}
