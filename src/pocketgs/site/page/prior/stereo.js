/**
 * Depth on the GPU; the twin of `prior/depth/webgpu/stereo.py`.
 *
 * @module
 */

import { Description } from "../../gpu/description.js";
import { Executor } from "../../gpu/executor.js";
import { comparisonFields, comparisonNumbers, otherRecords } from "./comparison_inputs.js";
import { inverseDepths, stepOf } from "./depth_range.js";
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

/** Of a pixel's depth and margin. */
const MAP_BYTES = 8;

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

    /**
     * Make buffers for sweeps of frames, and see that there could be those for comparing all depth maps.
     *
     * @param {import("../capture/camera.js").Camera[]} cameras at the size of a sweep
     * @param {number} keyframes their number
     * @throws {Error} the GPU's memory does not hold it
     */
    async reserve(cameras, keyframes) {
        const { most_hypotheses: hypotheses, most_bands: bands, source_views: sources, paths } = this.#settings;
        const [across, down] = ["width", "height"].map((side) => Math.max(...cameras.map((camera) => camera[side])));
        const { width, height } = cameras.reduce((a, b) => (a.width * a.height < b.width * b.height ? b : a));
        const numbers = { width, height, image_width: across, image_height: down };
        const given = { ...numbers, images: 1 + sources, hypotheses, paths };
        this.#comparing.check(this.#sizes(this.#comparing, { ...numbers, views: keyframes }));
        for (this.#bands = 1; this.#bands < bands; this.#bands++) {
            const sizes = this.#sizes(this.#sweeping, { ...given, bands: this.#bands });
            if (Math.max(...Object.values(sizes)) <= this.#sweeping.largestBuffer) {
                break;
            }
        }
        const sizes = this.#sizes(this.#sweeping, { ...given, bands: this.#bands });
        const bytes = Object.values(sizes).reduce((sum, size) => sum + size, MAP_BYTES * width * height * keyframes);
        if (bytes > this.mostBytes) {
            const [found, room] = [bytes, this.mostBytes].map((number) => Math.round(number / 1e6));
            throw new Error(`it would take ${found} MB, of which ${room} MB are left`);
        }
        await this.#sweeping.reserve(sizes);
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
        await executor.reserve(executor.description.sizes(symbols));
        executor.write("photographs", packed(frames, symbols, this.#settings));
        executor.write("sources", sourceRecords(keyframe.camera, sources.map(({ camera }) => camera)));
        executor.write("inverse_depths", inverse);
        const isBounded = search.farthest < Infinity;
        executor.writeUniform("sweep", sweepFields(sources, inverse, isBounded, symbols, this.#settings));
        // Drivers reset GPUs on which one submission takes too long.
        await executor.submitByPass("sweep", symbols, executor.description.sequences.sweep.passes.length, () => true);
        const depth = await executor.read("depths", Float32Array, symbols.pixels);
        return { depth, margin: await executor.read("margins", Float32Array, symbols.pixels), step };
    }

    /**
     * Compare every depth of each view with the other views' depths, one view after the other.
     *
     * @param {import("./comparison_inputs.js").View[]} views
     * @param {{tolerance: number, confidence: number}} thresholds maximum relative difference of agreeing depths, and
     *     minimum confidence outside holes
     * @returns {AsyncGenerator<ConfidenceMap>}
     */
    async *compare(views, thresholds) {
        this.#sweeping.free();
        const [executor, { description }] = [this.#comparing, this.#comparing];
        const numbers = views.map((_, view) => comparisonNumbers(views, view));
        const largest = numbers.reduce((a, b) => (a.width * a.height < b.width * b.height ? b : a));
        await executor.reserve(this.#sizes(executor, largest));
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
            const confidences = await executor.read("confidences", Float32Array, symbols.pixels);
            yield { confidences, footprints: await executor.read("footprints", Float32Array, symbols.pixels) };
        }
    }

    #sizes({ description }, given) {
        return description.sizes(description.symbols(given));
    }
}

function paddedTo(depth, { width, height }, { image_width: across, image_height: down }) {
    const padded = new Float32Array(across * down);
    for (let row = 0; row < height; row++) {
        padded.set(depth.subarray(row * width, (row + 1) * width), row * across);
    }
    return padded;
}
