/**
 * The geometry prior: from photographs with poses to refined poses and a dense cloud; the twin of `build_prior` in
 * `prior/prior.py`. Without features, which points the frames see comes from the capture's own cloud, or from sweeps of
 * small copies.
 *
 * @module
 */

import { completion, joined } from "./complete.js";
import { ViewCells } from "./coverage.js";
import { depthMap, sweptPixels } from "./depth_maps.js";
import { compensated, exposureGains, needsCompensation } from "./exposure.js";
import { NoRoomForFeatures } from "./features/finder.js";
import { fuse } from "./fuse.js";
import { selectKeyframes } from "./keyframes.js";
import { merged } from "./merge.js";
import { cameraWithin } from "./photographs.js";
import { MisreadPoses, readIn } from "./poses/convention.js";
import { buildStructure, pointsSeen, sparseCloud, structureOfFrames } from "./poses/structure.js";
import { roughPoints } from "./rough_points.js";
import { scaleOf } from "./scale.js";
import { seenPoints } from "./seen_points.js";
import { NoRoom } from "./stereo.js";

/**
 * @typedef {import("../capture/open.js").Capture} Capture
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 *
 * @typedef {Object} Listener
 * @property {(text: string, share: number) => Promise<void>} onStage called before each piece of work; rejects to stop
 * @property {(text: string) => void} onWarning
 */

/** Photographs that a warning names at most. */
const NAMED = 8;

/**
 * @param {Capture} given
 * @param {{most: number, refines: boolean}} options maximum size of the cloud, and whether features are found, by which
 *     poses are refined and exposures compared
 * @param {Object} settings
 * @param {{stereo: import("./stereo.js").Stereo, finder: import("./features/finder.js").FeatureFinder}} gpu
 * @param {Listener} listener
 * @returns {Promise<{capture: Capture, dense: Dense | NoRoom}>} the capture with refined poses and training photographs
 *     of one exposure; and why there is no cloud where the GPU's memory does not hold depth
 */
export async function buildPrior(given, { most, refines }, settings, { stereo, finder }, { onStage, onWarning }) {
    const { prior } = settings;
    await onStage("comparing poses", 0);
    const { capture, structure } = refines
        ? await posed(given, settings, finder, { onStage, onWarning })
        : { capture: given, structure: null };
    const scale = scaleOf(capture, settings);
    const frames = framesOf(capture);
    const sound = frames.map((_, i) => i).filter((i) => i < capture.train.length && !structure?.unplaced[i]);
    const own = structure && structureOfFrames(structure, sound);
    const refined = structure ? withStructure(capture, structure, own, scale, prior) : capture;
    if (structure && [...structure.replaced, ...structure.unplaced].some(Boolean)) {
        onWarning(contradiction(frames.map(({ name }) => name), structure));
    }
    const dense = await denseCloud(refined, own, most, scale, prior, stereo, onStage).catch((error) => {
        if (!(error instanceof NoRoom)) {
            throw error;
        }
        return error;
    });
    return { capture: refined, dense };
}

/**
 * @typedef {Object} Dense
 * @property {Cloud} cloud
 * @property {number} covered share of the training pixels
 * @property {number} keyframes their number
 *
 * @returns {Promise<Dense>}
 * @throws {NoRoom} the GPU's memory does not hold it
 */
async function denseCloud(capture, own, most, { distance }, prior, stereo, onStage) {
    await onStage("choosing keyframes", 0);
    const { train } = capture;
    const views = new ViewCells(train, prior.coverage);
    const { points, sources } = own
        ? knownByFeatures(capture, own)
        : await knownWithoutFeatures(capture, views, distance, prior, stereo, onStage);
    const chosen = selectKeyframes(train, points, distance, prior.keyframes);
    const candidates = await swept(chosen, train, points, distance, prior, stereo, onStage);
    await onStage("merging depth maps", 1);
    let fused = merged(candidates, most, prior.merging);
    await onStage("filling holes", 1);
    const { added, covered } = completion(fused, views, sources, distance, most, prior.coverage);
    const rest = most - added.positions.length / 3;
    if (fused.positions.length / 3 > rest) {
        fused = merged(candidates, rest, prior.merging);
    }
    return { cloud: joined([fused, added]), covered, keyframes: chosen.length };
}

const framesOf = ({ train, heldOut }) => [...train, ...heldOut];

/** The capture and its structure; with poses read in another convention if the photographs fit them only so. */
async function posed(capture, settings, finder, listener) {
    const built = async (capture) => {
        const found = foundBy(finder, framesOf(capture), scaleOf(capture, settings), settings.prior, listener);
        return { capture, structure: await found };
    };
    return built(capture).catch((error) => {
        if (!(error instanceof MisreadPoses)) {
            throw error;
        }
        listener.onWarning(`${error.message}: they are read so.`);
        return built(reread(capture, error.convention));
    });
}

function reread({ train, heldOut, cloud, ...rest }, convention) {
    const read = (frames) => frames.map((frame) => ({ ...frame, camera: readIn(frame.camera, convention) }));
    // Inverted transforms lead to another world than that of the capture's points.
    return { ...rest, train: read(train), heldOut: read(heldOut), cloud: convention.isInverted ? null : cloud };
}

/** Points and poses by features; null if there is too little texture or memory. The GPU is free again afterwards. */
async function foundBy(finder, frames, scale, settings, { onStage, onWarning }) {
    if (!finder.hasRoomFor(frames.length)) {
        onWarning("There is too little memory to find features: poses stay as they are.");
        return null;
    }
    try {
        const structure = await buildStructure(frames, scale, settings, finder, onStage);
        if (!structure) {
            onWarning("The photographs have too few features in common: poses stay as they are.");
        }
        return structure;
    } catch (error) {
        if (!(error instanceof NoRoomForFeatures)) {
            throw error;
        }
        onWarning(`Features are not found: ${error.message}. Poses stay as they are.`);
        return null;
    } finally {
        finder.release();
    }
}

/** A warning that names photographs whose poses were wrong. */
function contradiction(names, { replaced, unplaced }) {
    const listed = (said, which) => {
        const chosen = names.filter((_, i) => which[i]);
        const named = chosen.slice(0, NAMED).join(", ") + (chosen.length > NAMED ? ", ..." : "");
        return chosen.length ? ` ${chosen.length} ${said}: ${named}.` : "";
    };
    const fates = listed("placed anew", replaced) + listed("left out", unplaced);
    return `Some photographs have poses that the others contradict.${fates}`;
}

/**
 * The capture with the structure's poses, without photographs whose poses are wrong, and with training photographs of
 * one exposure if theirs jump by the structure of their own.
 */
function withStructure(capture, structure, own, { distance }, settings) {
    const posed = (frames, first) => {
        const all = frames.map((frame, i) => ({ ...frame, camera: structure.cameras[first + i] }));
        return all.filter((_, i) => !structure.unplaced[first + i]);
    };
    const [train, heldOut] = [posed(capture.train, 0), posed(capture.heldOut, capture.train.length)];
    const gains = exposureGains(train, own, distance, settings.exposure);
    const isNeeded = needsCompensation(own.cameras, gains, distance, settings.exposure);
    return { ...capture, train: isNeeded ? compensated(train, gains, settings.exposure) : train, heldOut };
}

/**
 * For each frame the points that it sees; and clouds for what depth does not cover, best first. The capture's own is in
 * the world of its original poses.
 */
function knownByFeatures({ train, cloud }, own) {
    const sources = [sparseCloud(train, own), ...(cloud && !own.isAdjusted ? [cloud] : [])];
    return { points: pointsSeen(own), sources };
}

/**
 * The same from the capture's own cloud, or if no frame sees any of it from sweeps of small copies. The GPU's memory is
 * free again afterwards.
 */
async function knownWithoutFeatures({ train, cloud }, views, distance, settings, stereo, onStage) {
    const sources = cloud ? [cloud] : [];
    const seen = cloud ? seenPoints(cloud, views, settings) : [];
    if (seen.some(({ length }) => length > 0)) {
        return { points: seen, sources };
    }
    const onFrame = (done) => onStage(`rough depth of photograph ${done + 1} of ${train.length}`, done / train.length);
    try {
        return { points: await roughPoints(train, distance, settings, stereo, onFrame), sources };
    } finally {
        stereo.release();
    }
}

/** The consistent pixels of all keyframes' depth maps. The GPU's memory is free again afterwards. */
async function swept(chosen, frames, points, distance, settings, stereo, onStage) {
    const size = sweptPixels(chosen.length, settings.sweep);
    try {
        await stereo.reserve(frames.map(({ camera }) => cameraWithin(camera, size)), chosen.length);
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
