/**
 * Features on the GPU: where they are, and which of two photographs' features match; the twin of
 * `prior/features/webgpu/finder.py`.
 *
 * @module
 */

import { Description } from "../../../gpu/description.js";
import { Executor } from "../../../gpu/executor.js";
import { Generator } from "../../random/generator.js";
import { frameWithin, isUsable } from "../photographs.js";

/**
 * @typedef {import("../../capture/photograph.js").Frame} Frame
 *
 * @typedef {Object} Features of one photograph
 * @property {Float64Array} pixels (N, 2) positions in the frame; the centre of the top left pixel is (0.5, 0.5)
 * @property {number} count N
 * @property {number} grain side of a pixel of the image used for detection, in pixels of the frame
 */

/** Words of a feature, see `feature.wgsl`; and where some of them stand. */
const [RECORD, RESPONSE, ANGLE, OCTAVE, LAYER] = [8, 3, 4, 5, 6];

/** Words of a descriptor's nearest, see `nearest.wgsl`. */
const NEAREST = 3;

/** With less room per photograph, too few features would be found. */
const LEAST_PIXELS = 10_000;

/** Detects features in photographs, keeps their descriptors, and matches them. */
export class FeatureFinder {
    #finding;
    #matching;
    #settings;
    /** Of each photograph, (N, 128). @type {Float32Array[]} */
    #descriptors = [];

    /** Bytes that all buffers and descriptors may take together. */
    mostBytes = Infinity;

    /**
     * Compile what features need.
     *
     * @param {GPUDevice} device
     * @param {{finding: Object, matching: Object}} passes from `features_passes.json`
     * @param {Object} settings the settings' `features`
     * @returns {Promise<FeatureFinder>}
     */
    static async open(device, passes, settings) {
        const finder = new FeatureFinder(device, passes, settings);
        await finder.#finding.prepare();
        await finder.#matching.prepare();
        return finder;
    }

    constructor(device, { finding, matching }, settings) {
        this.#finding = new Executor(device, new Description(finding));
        this.#matching = new Executor(device, new Description(matching));
        this.#settings = settings;
    }

    /** Bytes of all buffers on the GPU. */
    get bytes() {
        return this.#finding.bytes + this.#matching.bytes;
    }

    /**
     * Whether there is memory for the features of so many photographs, which may have to be reduced.
     *
     * @param {number} photographs
     * @returns {boolean}
     */
    hasRoomFor(photographs) {
        return this.#mostPixels(photographs) >= LEAST_PIXELS;
    }

    /** Give the GPU's memory back, and forget the descriptors. */
    release() {
        this.#finding.free();
        this.#matching.free();
        this.#descriptors = [];
    }

    /**
     * Detect the strongest features of photographs where masks and alpha leave them, in place of those before.
     *
     * @param {Frame[]} frames
     * @param {(done: number) => Promise<void>} onFrame called before each photograph; rejects to stop
     * @returns {Promise<Features[]>}
     */
    async detect(frames, onFrame) {
        this.#descriptors = [];
        const found = [];
        for (const [done, frame] of frames.entries()) {
            await onFrame(done);
            found.push(await this.#detectIn(frame, this.#mostPixels(frames.length)));
        }
        this.#finding.free();
        return found;
    }

    /**
     * Match features that are mutual nearest neighbours and pass the ratio test.
     *
     * @param {number} first number of a photograph
     * @param {number} second of another
     * @returns {Promise<Int32Array>} (M, 2) numbers of features of the first and the second
     */
    async match(first, second) {
        if (Math.min(this.#count(first), this.#count(second)) < 2) {
            return new Int32Array(0);
        }
        const found = await this.#nearest(this.#descriptors[first], this.#descriptors[second]);
        return mutualMatches(found.forwards, found.backwards, this.#settings.ratio);
    }

    /**
     * The word of each feature: the nearest of random features of all photographs. Clustering would hardly give better
     * ones.
     *
     * @param {number} most words
     * @param {(done: number) => Promise<void>} onPhotograph called before each one; rejects to stop
     * @returns {Promise<Uint32Array[]>} for each photograph (N,) numbers of words
     */
    async words(most, onPhotograph) {
        const words = this.#drawn(most);
        const found = [];
        for (const [done, own] of this.#descriptors.entries()) {
            await onPhotograph(done);
            const { forwards } = own.length ? await this.#nearest(own, words) : { forwards: new Uint32Array(0) };
            found.push(forwards.filter((_, i) => i % NEAREST === 0));
        }
        return found;
    }

    /** Random descriptors, the same as in Python, in their order. */
    #drawn(most) {
        const { descriptor: size } = this.#settings;
        const all = this.#descriptors.flatMap((own) => {
            return Array.from({ length: own.length / size }, (_, i) => own.subarray(size * i, size * (i + 1)));
        });
        const chosen = new Generator(0).permutation(all.length).slice(0, most).sort();
        const words = new Float32Array(size * chosen.length);
        chosen.forEach((number, i) => words.set(all[number], size * i));
        return words;
    }

    /** For each descriptor of either the nearest of the other's, see `nearest.wgsl`. */
    async #nearest(first, second) {
        const [rows, columns] = [first, second].map(({ length }) => length / this.#settings.descriptor);
        const executor = this.#matching;
        const symbols = executor.description.symbols({ first: rows, second: columns });
        await executor.reserve(executor.description.sizes(symbols)).catch(refused);
        executor.write("first_descriptors", first);
        executor.write("second_descriptors", second);
        executor.writeUniform("sizes", { rows, columns });
        executor.submit("match", symbols);
        const forwards = await executor.read("forwards", Uint32Array, NEAREST * rows);
        return { forwards, backwards: await executor.read("backwards", Uint32Array, NEAREST * columns) };
    }

    /** The largest photograph, in pixels, that memory holds beside all descriptors; larger ones are reduced. */
    #mostPixels(photographs) {
        const { octave_bytes: largest, pixel_bytes: all, other_bytes: others, descriptor, most } = this.#settings;
        const room = this.mostBytes - others - 4 * descriptor * most * photographs;
        return Math.floor(Math.min(this.#finding.largestBuffer / largest, room / all));
    }

    #count(photograph) {
        return this.#descriptors[photograph].length / this.#settings.descriptor;
    }

    async #detectIn(frame, mostPixels) {
        const small = frameWithin(frame, mostPixels);
        const { width, height } = small.camera;
        const { most } = this.#settings;
        const given = { width, height, chosen: most };
        const { found, pixels } = unmasked(small, strongest(await this.#find(small, given), most));
        this.#descriptors.push(await this.#describe(found, { ...given, chosen: found.length / RECORD }));
        const [across, down] = [frame.camera.fx / small.camera.fx, frame.camera.fy / small.camera.fy];
        if (small !== frame) {
            for (let i = 0; i < pixels.length; i += 2) {
                pixels[i] = (pixels[i] - small.camera.cx) * across + frame.camera.cx;
                pixels[i + 1] = (pixels[i + 1] - small.camera.cy) * down + frame.camera.cy;
            }
        }
        return { pixels, count: pixels.length / 2, grain: Math.sqrt(across * down) };
    }

    /** All features of a photograph, in no particular order. */
    async #find(frame, given) {
        const executor = this.#finding;
        const symbols = executor.description.symbols(given);
        await executor.reserve(executor.description.sizes(symbols)).catch(refused);
        executor.write("grey", greyLevels(frame));
        executor.write("kernels", Float32Array.from(this.#settings.kernels.flat()));
        this.#submitByOctave("find", symbols);
        const [, features] = await executor.read("counts", Uint32Array, 2);
        const count = Math.min(features, symbols.feature_room);
        return count ? executor.read("features", Uint32Array, RECORD * count) : new Uint32Array(0);
    }

    /** Descriptors of features of the photograph whose scale space is there. */
    async #describe(found, given) {
        if (!found.length) {
            return new Float32Array(0);
        }
        const executor = this.#finding;
        const symbols = executor.description.symbols(given);
        executor.write("features", found);
        this.#submitByOctave("describe", symbols);
        return executor.read("descriptors", Float32Array, this.#settings.descriptor * given.chosen);
    }

    /** Run an octave's sequence for each octave that the photograph has. */
    #submitByOctave(what, symbols) {
        const fields = Object.keys(this.#finding.description.uniforms.image.fields);
        for (let octave = 0; octave < symbols.octaves; octave++) {
            const values = { ...symbols, octave };
            this.#finding.writeUniform("image", Object.fromEntries(fields.map((name) => [name, values[name]])));
            this.#finding.submit(`${what} in octave ${octave}`, symbols);
        }
    }
}

/** The GPU's memory does not hold what features take. */
export class NoRoomForFeatures extends Error {}

function refused({ message }) {
    throw new NoRoomForFeatures(message);
}

/** Grey levels in OpenCV's fixed point. */
function greyLevels({ rgba }) {
    const levels = new Float32Array(rgba.length / 4);
    for (let i = 0; i < levels.length; i++) {
        levels[i] = (9798 * rgba[4 * i] + 19235 * rgba[4 * i + 1] + 3735 * rgba[4 * i + 2] + (1 << 14)) >> 15;
    }
    return levels;
}

/** At most so many different features, the strongest, in an order that does not depend on the GPU's. */
function strongest(records, most) {
    const numbers = new Float32Array(records.buffer);
    const order = Array.from({ length: records.length / RECORD }, (_, i) => RECORD * i).sort(
        (a, b) =>
            numbers[b + RESPONSE] - numbers[a + RESPONSE] ||
            records[a + OCTAVE] - records[b + OCTAVE] ||
            records[a + LAYER] - records[b + LAYER] ||
            numbers[a + 1] - numbers[b + 1] ||
            numbers[a] - numbers[b] ||
            numbers[a + ANGLE] - numbers[b + ANGLE],
    );
    const isSame = (a, b) => records.subarray(a, a + RECORD).every((word, i) => word === records[b + i]);
    const different = order.filter((at, i) => i === 0 || !isSame(at, order[i - 1]));
    return joined(different.slice(0, most).map((at) => records.subarray(at, at + RECORD)));
}

function joined(parts) {
    const whole = new Uint32Array(RECORD * parts.length);
    parts.forEach((part, i) => whole.set(part, RECORD * i));
    return whole;
}

/** The features that lie on usable pixels, and their positions in the photograph. */
function unmasked(frame, records) {
    const numbers = new Float32Array(records.buffer);
    const { width, height } = frame.camera;
    const [kept, pixels] = [[], []];
    for (let at = 0; at < records.length; at += RECORD) {
        const side = 2 ** (records[at + OCTAVE] - 1);
        const [x, y] = [numbers[at] * side + 0.5, numbers[at + 1] * side + 0.5];
        const [column, row] = [Math.min(Math.trunc(x), width - 1), Math.min(Math.trunc(y), height - 1)];
        if (isUsable(frame, row * width + column)) {
            kept.push(records.subarray(at, at + RECORD));
            pixels.push(x, y);
        }
    }
    return { found: joined(kept), pixels: Float64Array.from(pixels) };
}

/** The twin of `mutual_matches` in `prior/features/features.py`. */
function mutualMatches(forwards, backwards, ratio) {
    const products = new Float32Array(forwards.buffer);
    const matches = [];
    for (let i = 0; i < forwards.length; i += NEAREST) {
        const [other, best, next] = [forwards[i], products[i + 1], products[i + 2]];
        const isMutual = backwards[NEAREST * other] === i / NEAREST;
        if (isMutual && 2 - 2 * best < ratio * ratio * (2 - 2 * next)) {
            matches.push(i / NEAREST, other);
        }
    }
    return Int32Array.from(matches);
}
