/**
 * Opening a capture: recognise its format, read it, split it, load its photographs; see `capture/open.py`.
 *
 * @module
 */

import { FileTree } from "../archive/tree.js";
import { filesInZip } from "../archive/zip.js";
import { medianOf } from "../numbers/quantiles.js";
import * as blender from "./blender.js";
import { centreOf } from "./camera.js";
import * as colmap from "./colmap.js";
import { withReadableDepth } from "./depth_map.js";
import { damage, DamagedImageError } from "./image_header.js";
import { damagedWarning, depthWarnings, maskedOutWarning, maskWarnings } from "./left_out.js";
import { heldOutOf } from "./listing.js";
import * as nerfstudio from "./nerfstudio.js";
import { withMasks } from "./masks.js";
import { decodedPhotograph, prepared } from "./photograph.js";
import { plainBackground } from "./plain_background.js";
import * as polycam from "./polycam.js";
import * as record3d from "./record3d.js";
import * as scannerApp from "./scanner_app.js";
import * as strayScanner from "./stray_scanner.js";
import { isRecording, unrecognised } from "./unrecognised.js";
import { Video } from "./video.js";

/**
 * @typedef {import("./listing.js").Listing} Listing
 * @typedef {import("./photograph.js").Frame} Frame
 *
 * @typedef {Object} Capture
 * @property {Frame[]} train
 * @property {Frame[]} heldOut
 * @property {import("./listing.js").Cloud | null} cloud
 * @property {number[]} background
 * @property {boolean} isMetric whether lengths are metres
 * @property {string[]} warnings
 */

/** Folders around a capture. */
const DEEPEST = 9;

/** The first that recognises a folder reads it: an app's own data goes before what was converted from it. */
const READERS = [strayScanner, record3d, scannerApp, polycam, blender, nerfstudio, colmap];

/**
 * Read what a capture says of its frames. An archive often holds a folder with the capture in it, or a recording.
 *
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @param {(done: number, of: number) => void} onProgress called while the sharpest frames are sought
 * @returns {Promise<Listing>}
 * @throws {Error} no format is recognised, or the capture is malformed
 */
export async function readListing(tree, bounds, onProgress = () => {}) {
    const [place, reader] = await located(tree, bounds);
    const stated = await reader.read(place, bounds, onProgress);
    const listing = withReadableDepth(await withMasks(stated, place, bounds));
    const names = listing.frames.map(({ name }) => name);
    const repeated = names.find((name, i) => names.indexOf(name) !== i);
    if (repeated !== undefined) {
        throw new Error(`the capture lists the image ${repeated} more than once, expected each once`);
    }
    if (!names.length) {
        throw new Error("the capture lists no frame, expected at least one");
    }
    requireNearOrigin(listing, bounds);
    return listing;
}

/**
 * Load a capture's photographs.
 *
 * @param {Listing} listing
 * @param {number} most pixels of the longer side
 * @param {{capture: Object, run: Object}} settings
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<Capture>}
 * @throws {Error} one cannot be used, or none is left to train on
 */
export async function loadCapture(listing, most, settings, onProgress) {
    const { frames, background, cloud, isMetric, warnings } = listing;
    const heldOut = heldOutOf(listing, settings.run);
    if (frames.every(({ name }) => heldOut.has(name))) {
        throw new Error(`all of the capture's ${frames.length} frames are held out, expected one to train on`);
    }
    const [loaded, damaged] = [[], new Map()];
    for await (const [source, pixels] of decodedFrames(frames, settings.capture, damaged)) {
        // Depth maps of keyframes are completed, which are frames to train on.
        const used = heldOut.has(source.name) ? { ...source, depth: null } : source;
        loaded.push(await prepared(used, pixels, background, most, settings.capture));
        onProgress(loaded.length + damaged.size, frames.length);
    }
    const used = loaded.filter(({ mask }) => mask?.includes(255) ?? true);
    const train = used.filter(({ name }) => !heldOut.has(name));
    const unused = [...damagedWarning(damaged, frames.length), ...maskedOutWarning(loaded, used)];
    if (!train.length) {
        throw new Error(`${unused.at(-1)}; no frame is left to train on`);
    }
    const sound = frames.filter(({ name }) => !damaged.has(name));
    const rest = used.filter(({ name }) => heldOut.has(name));
    const isWithout = ({ name, depth }, i) => depth && !loaded[i].depth && !heldOut.has(name);
    const isWithoutMask = ({ mask }, i) => mask && !loaded[i].mask;
    const isUnmeasured = !heldOut.size && frames.length < settings.run.fewest_to_hold_out;
    const unmeasured = `fewer than ${settings.run.fewest_to_hold_out} frames: none is held out to measure quality on`;
    const leftOut = [
        ...(isUnmeasured ? [unmeasured] : []),
        ...unused,
        ...(await maskWarnings(sound.filter(isWithoutMask))),
        ...(await depthWarnings(sound.filter(isWithout))),
    ];
    const behind = plainBackground(train, settings.capture) ?? background;
    return { train, heldOut: rest, cloud, background: behind, isMetric, warnings: [...warnings, ...leftOut] };
}

/**
 * Every frame with its pixels. The frames of a capture are photographs, or those of one video. Photographs that cannot be
 * decoded are left out, and their errors are added to `damaged` by name.
 */
async function* decodedFrames(sources, bounds, damaged) {
    if (sources[0].frame === null) {
        for (const source of sources) {
            const found = await decodedPhotograph(source, bounds).catch(damage);
            if (found instanceof DamagedImageError) {
                damaged.set(source.name, found);
            } else {
                yield [source, found];
            }
        }
        return;
    }
    const video = await Video.of(sources[0].file);
    let at = 0;
    for await (const pixels of video.frames(sources.map(({ frame }) => frame))) {
        yield [sources[at++], pixels];
    }
}

/**
 * The tree itself, or the only folder or .r3d file in it that is a capture, with its reader. It may lie deeper than in
 * Python: of an archive, users cannot choose a part.
 */
async function located(tree, bounds) {
    let places = [tree];
    for (let depth = 0; depth <= DEEPEST && places.length; depth++) {
        const readers = await Promise.all(places.map((place) => readerOf(place, bounds)));
        const captures = places.map((place, i) => [place, readers[i]]).filter(([, reader]) => reader);
        if (captures.length > 1) {
            throw new Error(`${captures.length} captures are in one: choose one of them`);
        }
        if (captures.length) {
            return captures[0];
        }
        places = [...places.flatMap(foldersIn), ...(await recordingIn(places))];
    }
    throw new Error(unrecognised(tree));
}

function foldersIn(tree) {
    const inFolders = tree.paths.filter((path) => path.includes("/"));
    const names = new Set(inFolders.map((path) => path.slice(0, path.indexOf("/"))));
    return [...names].map((name) => tree.below(name));
}

/** The content of the only .r3d file directly in some places; several are not unpacked to be refused. */
async function recordingIn(places) {
    const files = places.flatMap((place) => place.pathsIn("", isRecording).map((path) => place.find(path)));
    if (files.length > 1) {
        throw new Error(`${files.length} recordings are in one, such as ${files[0].path}: choose one of them`);
    }
    return Promise.all(files.map(async (file) => new FileTree(await filesInZip(await file.blob(), file.path))));
}

async function readerOf(tree, bounds) {
    for (const reader of READERS) {
        if (await reader.recognises(tree, bounds)) {
            return reader;
        }
    }
    return undefined;
}

/** Scenes have 24 bits a coordinate, too few far from the origin. */
function requireNearOrigin({ frames, isMetric }, { far, extent_share: share, one_point: onePoint, metric_extent: least }) {
    const centres = frames.map(({ camera }) => centreOf(camera));
    const middle = [0, 1, 2].map((axis) => medianOf(centres.map((centre) => centre[axis])));
    const spreads = centres.map((centre) => Math.max(...centre.map((value, i) => Math.abs(value - middle[i]))));
    const spread = spreads.sort((a, b) => a - b)[Math.floor(share * (spreads.length - 1))];
    const extent = Math.max(spread, isMetric ? least : 0);
    const distance = Math.max(...middle.map(Math.abs));
    if (extent > onePoint * distance && distance > far * extent) {
        throw new Error(
            `the cameras are ${Math.round(distance)} from the origin and ${extent.toPrecision(3)} between most of them: ` +
                "expected coordinates near the origin; `pocketgs train` moves them",
        );
    }
}
