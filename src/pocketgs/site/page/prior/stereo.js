/**
 * Depth on the GPU; the twin of `prior/depth/webgpu/stereo.py`.
 *
 * @module
 */

import { Description } from "../../gpu/description.js";
import { Executor } from "../../gpu/executor.js";
import { totalOf } from "../training/buffer_sizes.js";
import { comparisonFields, comparisonNumbers, otherRecords } from "./comparison_inputs.js";
import { inverseDepths, stepOf } from "./depth_range.js";
import { stereoNeed } from "./stereo_need.js";
import { packed, sourceRecords, sweepFields, sweepNumbers } from "./sweep_inputs.js";

/**
 * @typedef {import("../capture/photograph.js").Frame} Frame
 *
 * @typedef {Object} DepthMap
 * @property {Float32Array} depth (H, W) along the optical axis, 0 where unknown
 * @property {Float32Array} margin (H, W) share by which the depth is cheaper than the next best
 * @property {number} step difference in inverse depth of neighbouring hypotheses
 *
 * @typedef {Object} ConfidenceMap how far one view's depths are believed
 * @property {Float32Array} confidences (H, W) in [0, 1], 0 for depths that are not used
 * @property {Float32Array} footprints (H, W) smallest footprint of a pixel at the point
 */

/** The GPU's memory does not hold what depth takes. */
export class NoRoom extends Error {}

function refused({ message }) {
    throw new NoRoom(message);
}

/** Sweeps keyframes and compares their depth maps. */
export class Stereo {
    #sweeping;
    #comparing;
    #settings;
    #bands = 1;

    /** Bytes that all buffers and depth maps may take together. */
    mostBytes = Infinity;

    /**
     * Compile what sweeps and comparisons need.
     *
     * @param {GPUDevice} device
     * @param {{sweep: Object, comparison: Object}} passes from `depth_passes.json`
     * @param {Object} settings the settings' `sweep`
     * @returns {Promise<Stereo>}
     */
    static async open(device, passes, settings) {
        const stereo = new Stereo(device, passes, settings);
        await stereo.#sweeping.prepare({ bands: 1, paths: settings.paths });
        await stereo.#comparing.prepare();
        return stereo;
    }

    constructor(device, { sweep, comparison }, settings) {
        this.#sweeping = new Executor(device, new Description(sweep));
        this.#comparing = new Executor(device, new Description(comparison));
        this.#settings = settings;
    }

    /** Bytes of all buffers on the GPU. */
    get bytes() {
        return this.#sweeping.bytes + this.#comparing.bytes;
    }

    /** The passes of depth, by which memory is planned. */
    get descriptions() {
        return { sweep: this.#sweeping.description, comparison: this.#comparing.description };
    }

    /**
     * Make buffers for sweeps of frames, and see that there could be those for comparing all depth maps.
     *
     * @param {import("../numbers/resizing.js").Size[]} frames at the size of a sweep
     * @param {number} keyframes their number
     * @throws {NoRoom} the GPU's memory does not hold it
     */
    async reserve(frames, keyframes) {
        const { largestBuffer } = this.#sweeping;
        const need = stereoNeed(this.descriptions, frames, keyframes, largestBuffer, this.#settings);
        this.#bands = need.bands;
        const bytes = totalOf(need.sweeping) + need.mapBytes;
        if (bytes > this.mostBytes) {
            const [found, room] = [bytes, this.mostBytes].map((number) => Math.round(number / 1e6));
            throw new NoRoom(`it would take ${found} MB, of which ${room} MB are left`);
        }
        try {
            this.#comparing.check(need.comparing);
            await this.#sweeping.reserve(need.sweeping);
        } catch (error) {
            refused(error);
        }
    }

    /** Give the GPU's memory back. */
    release() {
        this.#sweeping.free();
        this.#comparing.free();
    }

    /**
     * Compute the depth map of a keyframe.
     *
     * @param {Frame} keyframe
     * @param {Frame[]} sources if empty, no depth is known
     * @param {import("./depth_range.js").DepthRange} search
     * @returns {Promise<DepthMap>}
     * @throws {NoRoom} the GPU's memory is full
     */
    async sweep(keyframe, sources, search) {
        const { width, height } = keyframe.camera;
        const inverse = inverseDepths(search);
        const step = stepOf(inverse);
        if (!sources.length) {
            return { depth: new Float32Array(width * height), margin: new Float32Array(width * height), step };
        }
        const [executor, frames] = [this.#sweeping, [keyframe, ...sources]];
        const given = { ...sweepNumbers(frames, inverse, this.#settings), bands: this.#bands };
        const symbols = executor.description.symbols(given);
        await executor.reserve(executor.description.sizes(symbols)).catch(refused);
        executor.write("photographs", packed(frames, symbols, this.#settings));
        executor.write("sources", sourceRecords(keyframe.camera, sources.map(({ camera }) => camera)));
        executor.write("inverse_depths", inverse);
        const isBounded = search.farthest < Infinity;
        executor.writeUniform("sweep", sweepFields(sources, inverse, isBounded, symbols, this.#settings));
        // Drivers reset GPUs on which one submission takes too long.
        await executor.submitByPass("sweep", symbols, executor.description.sequences.sweep.passes.length, () => true);
        const [depth, margin] = await read(executor, ["depths", "margins"], symbols.pixels);
        return { depth, margin, step };
    }

    /**
     * Compare every depth of each view with the other views' depths, one view after the other.
     *
     * @param {import("./comparison_inputs.js").View[]} views
     * @param {{tolerance: number, confidence: number}} thresholds maximum relative difference of agreeing depths, and
     *     minimum confidence outside holes
     * @returns {AsyncGenerator<ConfidenceMap>}
     * @throws {NoRoom} the GPU's memory is full
     */
    async *compare(views, thresholds) {
        this.#sweeping.free();
        const [executor, { description }] = [this.#comparing, this.#comparing];
        const numbers = views.map((_, view) => comparisonNumbers(views, view));
        const largest = numbers.reduce((a, b) => (a.width * a.height < b.width * b.height ? b : a));
        await executor.reserve(description.sizes(description.symbols(largest))).catch(refused);
        views.forEach(({ camera, map }, view) => {
            const padded = paddedTo(map.depth, camera, largest);
            executor.write("maps", padded, padded.byteLength * view);
        });
        for (const [view, given] of numbers.entries()) {
            const symbols = description.symbols(given);
            executor.write("others", otherRecords(views, view, this.#settings.least_parallax));
            executor.write("margins", views[view].map.margin);
            executor.writeUniform("comparison", comparisonFields(views, view, given, thresholds));
            executor.submit("compare", symbols);
            const [confidences, footprints] = await read(executor, ["confidences", "footprints"], symbols.pixels);
            yield { confidences, footprints };
        }
    }
}

/** Copies of what passes have written: they need memory too. */
async function read(executor, names, count) {
    const copies = [];
    for (const name of names) {
        copies.push(await executor.read(name, Float32Array, count).catch(refused));
    }
    return copies;
}

function paddedTo(depth, { width, height }, { image_width: across, image_height: down }) {
    const padded = new Float32Array(across * down);
    for (let row = 0; row < height; row++) {
        padded.set(depth.subarray(row * width, (row + 1) * width), row * across);
    }
    return padded;
}
