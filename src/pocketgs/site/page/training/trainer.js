/**
 * Trains a scene on the GPU by replaying the engine's passes; the twin of `splat/webgpu/engine.py`. Steps are submitted
 * and not waited for. A step that needs more room for tiles' lists than there is changes nothing, and neither do those
 * after it: they are submitted again once there is room, so a run gives the same result however often that happens.
 *
 * @module
 */

import { Description } from "../../gpu/description.js";
import { Executor } from "../../gpu/executor.js";
import { MEAN } from "../../page/constants.js";
import { viewValues } from "../../page/drawing/view_values.js";
import { GaussianColumns } from "../../page/scene/gaussian_columns.js";
import { nearPlane } from "../../page/scene/near_plane.js";
import { expectedIntersections, largestSizes, symbolsOf, totalOf } from "./buffer_sizes.js";
import { PIXEL_BYTES, Shelf } from "./shelf.js";
import { structuralShare, updateValues } from "./update_values.js";

/**
 * @typedef {import("../capture/camera.js").Camera} Camera
 * @typedef {import("../capture/photograph.js").Frame} Frame
 * @typedef {import("./rates.js").Rates} Rates
 *
 * @typedef {Object} State what training needs besides the scene to go on where it stopped
 * @property {number[]} losses of all steps
 * @property {number} near
 * @property {Float32Array[]} moments first and second
 */

const MOMENTS = ["first_moments", "second_moments"];

/** A picture that cannot be drawn, while steps still can be made. */
export class PictureError extends Error {}

/** Holds the scene, and the optimiser's state. */
export class Trainer {
    #executor;
    #settings;
    /** @type {{camera: Camera, pixels: Uint8Array | null}[]} pixels of photographs without a place of their own */
    #frames = [];
    #background = [0, 0, 0];
    #shelf;
    #scene;
    #near = 0;
    #intersections = 0;
    /** Steps completed. */
    #completed = 0;
    #pending = [];
    #firstPending = 0;
    /** Steps that are submitted before the host looks. Until it is known how long one takes, it looks after each. */
    #most = 1;

    /** @type {number[]} loss of every completed step, before its update */
    losses = [];

    /** Bytes that all buffers may take together. */
    mostBytes = Infinity;

    /**
     * Compile all passes.
     *
     * @param {GPUDevice} device
     * @param {Object} passes from `passes.json`
     * @param {Object} settings from `settings.json`
     * @returns {Promise<Trainer>}
     */
    static async open(device, passes, settings) {
        const executor = new Executor(device, new Description(passes));
        await executor.prepare();
        return new Trainer(executor, settings);
    }

    constructor(executor, settings) {
        this.#executor = executor;
        this.#settings = settings;
    }

    /** Number of Gaussians. */
    get count() {
        return this.#scene?.count ?? 0;
    }

    /** What a plan has to know of the GPU and of training. */
    get device() {
        return { description: this.#executor.description, largestBuffer: this.#executor.largestBuffer };
    }

    /** Free the last run's buffers. */
    release() {
        this.#executor.free();
    }

    /** Bytes of all buffers on the GPU. */
    get bytes() {
        return this.#executor.bytes;
    }

    /**
     * Take photographs and a scene, and start the optimiser anew.
     *
     * @param {Frame[]} frames to train on; of those that lie on the GPU no other copy is kept
     * @param {number[]} background RGB in [0, 1]
     * @param {GaussianColumns} scene
     * @param {State | null} state of a run that goes on
     * @throws {Error} the GPU's memory does not hold it
     */
    async begin(frames, background, scene, state = null) {
        const { engine } = this.#settings;
        const executor = this.#executor;
        executor.free();
        [this.#background, this.#scene, this.#intersections] = [background, scene, 0];
        const room = Math.floor(executor.largestBuffer / PIXEL_BYTES);
        this.#shelf = new Shelf(frames.map(({ rgba }) => rgba.length / 4), room);
        this.#frames = frames.map(({ camera }) => ({ camera, pixels: null }));
        const sizes = this.#frames.map(({ camera }) => camera);
        const expected = expectedIntersections(scene.count, sizes, executor.largestBuffer, engine);
        await this.#makeRoom(expected, engine.min_intersections);
        for (const [view, frame] of frames.entries()) {
            if (this.#shelf.isResident(view)) {
                this.#shelve(view, countedPixels(frame));
                await executor.finished(); // until then there is another copy of the photograph
            } else {
                this.#frames[view].pixels = countedPixels(frame);
            }
        }
        executor.write("shape", scene.shape);
        executor.write("sh", scene.sh);
        for (const name of ["cluster_bounds", "colours", ...MOMENTS]) {
            executor.clear(name);
        }
        state?.moments.forEach((values, i) => executor.write(MOMENTS[i], values));
        this.#near = state?.near ?? nearPlane([0, 1, 2].map((axis) => scene.column(MEAN + axis)), scene.count);
        [this.#completed, this.losses, this.#pending] = [state?.losses.length ?? 0, state?.losses ?? [], []];
        this.#resume();
    }

    /**
     * Submit a step.
     *
     * @param {number} view number of the photograph
     * @param {Rates} rates
     * @param {{dropout_threshold: number, dropout_seed: number} | {}} dropout from `dropoutOfStep`
     * @returns {boolean} whether it is time to `settle`
     */
    step(view, rates, dropout = {}) {
        this.#firstPending ||= performance.now();
        this.#submit({ view, rates, dropout });
        const isStreamed = this.#frames[view].pixels !== null;
        const most = isStreamed ? this.#settings.engine.streamed_ahead : Infinity;
        return this.#pending.length >= Math.min(this.#most, most);
    }

    /** Wait until all steps are completed. */
    async settle() {
        const [taken, began] = [this.#pending.length, this.#firstPending];
        if (!taken) {
            return;
        }
        const before = this.#completed;
        while (this.#pending.length) {
            const [completed, halted, needed] = await this.#executor.read("status", Uint32Array, 3);
            const waiting = this.#pending.slice(completed - this.#completed);
            [this.#completed, this.#pending] = [completed, []];
            if (halted) {
                await this.#makeRoom(needed * this.#settings.engine.growth, needed);
                this.#resume();
            }
            waiting.forEach((step) => this.#submit(step));
        }
        this.#firstPending = 0;
        await this.#readLosses(before);
        const seconds = (performance.now() - began) / 1000 / taken;
        const { seconds_ahead: ahead, most_ahead: most } = this.#settings.engine;
        this.#most = Math.min(Math.max(Math.floor(ahead / seconds), 1), most);
    }

    /**
     * Draw the scene as it stands. Whether or not that succeeds, the next steps give the same.
     *
     * @param {Camera} camera
     * @returns {Promise<Float32Array>} (H, W, 4): colour, not cut off above 1, and transmittance
     * @throws {PictureError} there is no room for this picture
     */
    async render(camera) {
        await this.settle();
        try {
            return await this.#rendered(camera);
        } catch ({ message }) {
            await this.#recover();
            throw new PictureError(message);
        }
    }

    /** @returns {Promise<GaussianColumns>} a copy of the scene as it stands */
    async download() {
        await this.settle();
        const scene = new GaussianColumns(this.#scene.count, this.#scene.coefficients);
        scene.shape.set(await this.#executor.read("shape", Float32Array, scene.shape.length));
        scene.sh.set(await this.#executor.read("sh", Float32Array, scene.sh.length));
        return scene;
    }

    /** @returns {Promise<State>} a copy */
    async state() {
        await this.settle();
        const numbers = this.#symbols({ width: 1, height: 1 }).columns * this.#scene.count;
        const moments = [];
        for (const name of MOMENTS) {
            moments.push(await this.#executor.read(name, Float32Array, numbers));
        }
        return { losses: [...this.losses], near: this.#near, moments };
    }

    /** Wait until the GPU answers. Where it was lost this fails. */
    async answer() {
        await this.#executor.read("status", Uint32Array, 1);
    }

    async #rendered(camera) {
        const { description } = this.#executor;
        const buffers = description.buffersOf(["render"]);
        for (;;) {
            const symbols = this.#symbols(camera);
            await this.#executor.reserve(description.sizes(symbols, buffers));
            this.#writeView(camera, symbols);
            this.#executor.submit("render", symbols);
            const image = await this.#executor.read("image", Float32Array, 4 * symbols.pixels);
            const [, halted, needed] = await this.#executor.read("status", Uint32Array, 3);
            if (!halted) {
                return image;
            }
            await this.#makeRoom(needed * this.#settings.engine.growth, needed);
            this.#resume();
        }
    }

    /**
     * Make ready for the next step after a picture that could not be drawn. Buffers may be gone that were to grow for
     * it, and the GPU is halted. Where the GPU was lost this fails too: then the picture was not to blame.
     */
    async #recover() {
        await this.#executor.reserve(this.#sizesWith(this.#intersections));
        this.#resume();
        await this.answer();
    }

    #submit(step) {
        const { camera, pixels } = this.#frames[step.view];
        if (pixels) {
            this.#shelve(step.view, pixels);
        }
        const { recipe, engine } = this.#settings;
        const symbols = this.#symbols(camera, structuralShare(recipe.loss, camera, engine.ssim_window) > 0);
        const number = this.#completed + this.#pending.length + 1;
        this.#writeView(camera, symbols, { photograph: this.#shelf.place(step.view), ...step.dropout });
        const update = updateValues(recipe, step.rates, camera, symbols, number, step.view, engine);
        this.#executor.writeUniform("update", update);
        this.#executor.submit("step", symbols);
        this.#pending.push(step);
    }

    #writeView(camera, symbols, ofStep = {}) {
        const values = viewValues(camera, this.#background, this.#near, symbols);
        this.#executor.writeUniform("view", { ...values, ...ofStep });
    }

    #shelve(view, pixels) {
        this.#executor.write("photographs", pixels, PIXEL_BYTES * this.#shelf.place(view));
    }

    /** Let the lists of tiles hold as many intersections as are wanted, or at least those that are needed. */
    async #makeRoom(wanted, needed) {
        const most = Math.floor(this.#executor.largestBuffer / this.#settings.engine.intersection_bytes);
        for (const target of [Math.min(Math.ceil(wanted), most), needed]) {
            const intersections = Math.max(this.#intersections, needed, target);
            const sizes = this.#sizesWith(intersections);
            if (totalOf(sizes) <= this.mostBytes) {
                await this.#executor.reserve(sizes);
                this.#intersections = intersections;
                return;
            }
        }
        const found = `${needed.toLocaleString("en")} places where splats meet tiles do not fit`;
        throw new Error(`${found} into the memory that is left: expected smaller photographs or fewer splats`);
    }

    /** Bytes of all buffers for training, with room for so many intersections. */
    #sizesWith(intersections) {
        const extent = { ...this.#extent, intersections };
        return largestSizes(this.#executor.description, extent, this.#frames.map(({ camera }) => camera));
    }

    /** Let the GPU know how many steps are completed, and that nothing stands in the way of the next. */
    #resume() {
        this.#executor.write("status", Uint32Array.of(this.#completed, 0, 0));
    }

    async #readLosses(before) {
        const { kept_losses: kept } = this.#settings.engine;
        const ring = await this.#executor.read("losses", Float32Array, kept);
        for (let step = before; step < this.#completed; step++) {
            this.losses.push(ring[step % kept]);
        }
    }

    #symbols(size, structural = false) {
        return symbolsOf(this.#executor.description, this.#extent, size, structural);
    }

    get #extent() {
        return {
            gaussians: this.#scene.count,
            coefficients: this.#scene.coefficients,
            intersections: this.#intersections,
            photographs: this.#frames.length,
            photographPixels: this.#shelf.pixels,
        };
    }
}

/** A photograph with 255 in the fourth byte of pixels that count: those that no mask leaves out. */
function countedPixels({ rgba, mask }) {
    const pixels = new Uint8Array(rgba);
    for (let i = 0; i < pixels.length / 4; i++) {
        pixels[4 * i + 3] = mask?.[i] ?? 255;
    }
    return pixels;
}
