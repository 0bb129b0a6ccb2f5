/**
 * A training run: starts from a capture, and reports what becomes of it; see `training/loop.py`.
 *
 * @module
 */

import { mortonOrder } from "../seeding/morton.js";
import { seedDiscs } from "../seeding/discs.js";
import { selected, startingPoints } from "../seeding/points.js";
import { onScreen, psnr } from "./evaluation.js";
import { initialRates, pixelFootprint, ratesAt } from "./rates.js";
import { ViewOrder } from "./view_order.js";

/**
 * @typedef {import("../capture/open.js").Capture} Capture
 * @typedef {import("./trainer.js").Trainer} Trainer
 *
 * @typedef {Object} Options
 * @property {number} iterations
 * @property {number} gaussians maximum number
 * @property {number} seed
 *
 * @typedef {Object} Progress
 * @property {number} iteration
 * @property {number | null} loss mean over the last epoch
 * @property {number | null} held_out_psnr mean over the held-out views, as of the last look
 * @property {number} rate steps per second
 * @property {number} gaussians
 * @property {number} bytes of the GPU's buffers
 *
 * @typedef {Object} Listener
 * @property {(progress: Progress) => void} onProgress
 * @property {(picture: {width: number, height: number, rgba: Uint8ClampedArray}) => void} onPicture
 */

const MS_BETWEEN_PICTURES = 1500;

/** Can be paused, and stopped. */
export class Run {
    #trainer;
    #capture;
    #settings;
    #options;
    #listener;
    #iteration = 0;
    #psnr = null;
    #stopped = false;
    #paused = null;
    #spent = 0;

    /**
     * @param {Trainer} trainer
     * @param {Capture} capture
     * @param {Object} settings
     * @param {Options} options
     * @param {Listener} listener
     */
    constructor(trainer, capture, settings, options, listener) {
        this.#trainer = trainer;
        this.#capture = capture;
        this.#settings = settings;
        this.#options = options;
        this.#listener = listener;
        /** The photograph whose view is shown while training goes on. */
        this.shown = capture.heldOut[0] ?? capture.train[0];
    }

    /** Stop after the steps under way, until `resume`. */
    pause() {
        if (!this.#paused) {
            let resume;
            this.#paused = { over: new Promise((resolve) => (resume = resolve)), resume };
        }
    }

    resume() {
        this.#paused?.resume();
        this.#paused = null;
    }

    /** End after the steps under way, and keep the scene. */
    stop() {
        this.#stopped = true;
        this.resume();
    }

    /**
     * @returns {Promise<import("../../page/scene/gaussian_columns.js").GaussianColumns>} the trained scene
     * @throws {Error} there is nothing to start from, or the GPU's memory does not hold it
     */
    async go() {
        const { train, heldOut, background } = this.#capture;
        const cameras = train.map(({ camera }) => camera);
        const points = startingPoints(this.#capture, this.#options.gaussians, this.#options.seed, this.#settings);
        const { recipe, seeding } = this.#settings;
        const unit = pixelFootprint(cameras, points.positions);
        const order = mortonOrder(Float64Array.from(Float32Array.from(points.positions)), seeding.morton_bits);
        const seeds = seedDiscs(selected(points, order), recipe, seeding);
        await this.#trainer.begin(train, heldOut.map(({ camera }) => camera), background, seeds);
        await this.#iterate(initialRates(recipe, this.#options.iterations, unit));
        await this.#lookAtHeldOut();
        await this.#show();
        return this.#trainer.download();
    }

    async #iterate(initial) {
        const { iterations, seed } = this.#options;
        const order = new ViewOrder(this.#capture.train.length, seed);
        const every = this.#settings.run.evaluate_every;
        await this.#show();
        let shown = performance.now();
        let began = shown;
        while (this.#iteration < iterations && !this.#stopped) {
            const rates = ratesAt(initial, this.#settings.recipe.schedule, this.#iteration / iterations);
            const isTimeToLook = this.#trainer.step(order.at(this.#iteration), rates);
            this.#iteration++;
            if (!isTimeToLook && this.#iteration % every && this.#iteration < iterations) {
                continue;
            }
            await this.#trainer.settle();
            this.#spent += performance.now() - began;
            if (this.#iteration % every === 0 && this.#iteration < iterations) {
                await this.#lookAtHeldOut();
            }
            this.#report();
            if (performance.now() - shown > MS_BETWEEN_PICTURES) {
                await this.#show();
                shown = performance.now();
            }
            await this.#paused?.over;
            began = performance.now();
        }
    }

    async #lookAtHeldOut() {
        const { heldOut } = this.#capture;
        if (heldOut.length) {
            let sum = 0;
            for (const { camera, rgba } of heldOut) {
                sum += psnr(await this.#trainer.render(camera), rgba);
            }
            this.#psnr = sum / heldOut.length;
        }
        this.#report();
    }

    async #show() {
        const { camera } = this.shown;
        const rgba = onScreen(await this.#trainer.render(camera));
        this.#listener.onPicture({ width: camera.width, height: camera.height, rgba });
    }

    #report() {
        const latest = this.#trainer.losses.slice(-this.#capture.train.length);
        this.#listener.onProgress({
            iteration: this.#iteration,
            loss: latest.length ? latest.reduce((sum, loss) => sum + loss, 0) / latest.length : null,
            held_out_psnr: this.#psnr,
            rate: this.#spent ? (1000 * this.#iteration) / this.#spent : 0,
            gaussians: this.#trainer.count,
            bytes: this.#trainer.bytes,
        });
    }
}
