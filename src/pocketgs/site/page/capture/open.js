/**
 * Opening a capture: recognise its format, read it, split it, load its photographs; see `capture/open.py`.
 *
 * @module
 */

import { medianOf } from "../numbers/median.js";
import * as blender from "./blender.js";
import { centreOf } from "./camera.js";
import * as colmap from "./colmap.js";
import { heldOutOf } from "./listing.js";
import * as nerfstudio from "./nerfstudio.js";
import { loadPhotograph } from "./photograph.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("./listing.js").Listing} Listing
 * @typedef {import("./photograph.js").Frame} Frame
 *
 * @typedef {Object} Capture
 * @property {Frame[]} train
 * @property {Frame[]} heldOut
 * @property {import("./listing.js").Cloud | null} cloud
 * @property {number[]} background
 * @property {string[]} warnings
 */

/** The first that recognises a folder reads it. */
const READERS = [blender, nerfstudio, colmap];

/**
 * Read what a capture says of its frames. An archive often holds a folder with the capture in it.
 *
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<Listing>}
 * @throws {Error} no format is recognised, or the capture is malformed
 */
export async function readListing(tree, bounds) {
    const place = located(tree, bounds);
    const reader = READERS.find(({ recognises }) => place && recognises(place, bounds));
    if (!reader) {
        const expected = "transforms.json (nerfstudio), transforms_train.json (Blender) or COLMAP's sparse/0";
        throw new Error(`not a capture of a format that this page reads: expected ${expected}`);
    }
    const listing = await reader.read(place, bounds);
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
 * @param {{capture: Object, run: {hold_out_every: number}}} settings
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<Capture>}
 * @throws {Error} one cannot be used, or none is left to train on
 */
export async function loadCapture(listing, most, settings, onProgress) {
    const { frames, background, cloud, warnings } = listing;
    const heldOut = heldOutOf(listing, settings.run.hold_out_every);
    if (frames.every(({ name }) => heldOut.has(name))) {
        throw new Error(`all of the capture's ${frames.length} frames are held out, expected one to train on`);
    }
    const loaded = [];
    for (const source of frames) {
        loaded.push(await loadPhotograph(source, background, most, settings.capture));
        onProgress(loaded.length, frames.length);
    }
    const part = (isHeldOut) => loaded.filter(({ name }) => heldOut.has(name) === isHeldOut);
    return { train: part(false), heldOut: part(true), cloud, background, warnings };
}

/** The tree itself, or the only folder in it that is a capture. */
function located(tree, bounds) {
    const holds = (place) => READERS.some(({ recognises }) => recognises(place, bounds));
    if (holds(tree)) {
        return tree;
    }
    const inFolders = tree.paths.filter((path) => path.includes("/"));
    const folders = new Set(inFolders.map((path) => path.slice(0, path.indexOf("/"))));
    const captures = [...folders].map((folder) => tree.below(folder)).filter(holds);
    return captures.length === 1 ? captures[0] : null;
}

/** Scenes have 24 bits a coordinate, too few far from the origin. */
function requireNearOrigin({ frames }, { far }) {
    const centres = frames.map(({ camera }) => centreOf(camera));
    const middle = [0, 1, 2].map((axis) => medianOf(centres.map((centre) => centre[axis])));
    const extent = Math.max(...centres.flatMap((centre) => centre.map((value, i) => Math.abs(value - middle[i]))));
    const distance = Math.max(...middle.map(Math.abs));
    if (extent > 0 && distance > far * extent) {
        throw new Error(
            `the cameras are ${Math.round(distance)} from the origin and ${extent.toPrecision(3)} from each other: ` +
                "expected coordinates near the origin; `pocketgs train` moves them",
        );
    }
}
