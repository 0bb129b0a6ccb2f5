/**
 * A training run: starts from a capture, and reports what becomes of it; see `training/train.py`.
 *
 * @module
 */

import { mortonOrder } from "../seeding/morton.js";
import { seedDiscs } from "../seeding/discs.js";
import { distinctNeighbourhoods } from "../seeding/distinct.js";
import { selected } from "../seeding/points.js";
import { sceneOf } from "../storage/kept_run.js";
import { dropoutOfStep, dropoutShare, viewsPerPoint } from "./dropout.js";
import { Pictures } from "./pictures.js";
import { initialRates, pixelFootprint, ratesAt } from "./rates.js";
import { ViewOrder } from "./view_order.js";

/**
 * @typedef {import("../capture/open.js").Capture} Capture
 * @typedef {import("./trainer.js").Trainer} Trainer
 *
 * @typedef {Object} Options
 * @property {number} iterations
 * @property {number} gaussians maximum number
 * @property {"dense" | "none"} prior whether depth is computed first
 * @property {boolean} refines whether poses are refined before
 * @property {number} seed
 * @property {number} mostBufferBytes that the GPU's buffers may take together
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
 * @property {(picture: import("./pictures.js").Picture | null) => void} onPicture null where there was no room for it
 * @property {(text: string) => void} onComplaint
 * @property {(capture: Capture) => Promise<void>} onBegin called once a new run will not fail for want of memory, and
 *     cannot be cancelled any more
 * @property {(checkpoint: import("../storage/kept_run.js").Checkpoint | null) => Promise<void>} onCheckpoint null where
 *     there was no room to copy it from the GPU
 */

/** Milliseconds of training after which the run is kept again. */
const BETWEEN_CHECKPOINTS = 20_000;

/** Can be paused, stopped, and looked at. */
export class Run {
    #trainer;
    #settings;
    #options;
    #listener;
    #pictures;
    /** @type {Capture | null} until training begins: then the photographs lie on the GPU */
    #capture;
    #heldOut;
    #views;
    #iteration = 0;
    #first = 0;
    #psnr = null;
    #spent = 0;
    #isPaused = false;
    #isStopped = false;
    #isClosed = false;
    #asked = null;
    #wake = () => {};
    #mustKeep = true;
    #kept = 0;
    /** @type {import("./rates.js").Rates} */
    #initial;
    /** Share of the Gaussians that each step leaves out. */
    #dropout = 0;

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
        this.#heldOut = capture.heldOut;
        this.#views = capture.train.length;
        this.#settings = settings;
        this.#options = options;
        this.#listener = listener;
        this.#pictures = new Pictures(trainer, listener.onComplaint);
    }

    /** Stop after the steps under way, until `resume`. */
    pause() {
        this.#isPaused = true;
        this.keep();
    }

    /** Keep a checkpoint after the steps under way: the page may be closed soon. */
    keep() {
        this.#mustKeep = true;
        this.#wake();
    }

    resume() {
        this.#isPaused = false;
        this.#wake();
    }

    /** End after the steps under way, and keep the scene. */
    stop() {
        this.#isStopped = true;
        this.#wake();
    }

    /**
     * Ask for a picture, which comes once the steps under way are done; of several that were asked for, the last.
     *
     * @param {import("../capture/camera.js").Camera} camera
     */
    look(camera) {
        this.#asked = camera;
        this.#wake();
    }

    /** No more pictures are wanted of the finished run. */
    close() {
        this.#isClosed = true;
        this.#wake();
    }

    /**
     * Train.
     *
     * @param {import("../capture/listing.js").Cloud} points to start from
     * @param {import("../seeding/neighbour_search.js").NeighbourSearch} search
     * @param {AbortSignal} signal ends what comes before the first step
     * @returns {Promise<import("../../page/scene/gaussian_columns.js").GaussianColumns>} the trained scene
     * @throws {Error} the GPU's memory does not hold it, or it was ended
     */
    async go(points, search, signal) {
        const { train, background } = this.#capture;
        const { recipe, seeding } = this.#settings;
        const cameras = train.map(({ camera }) => camera);
        const unit = pixelFootprint(cameras, points.positions, recipe.most_depths);
        const views = viewsPerPoint(cameras, points.positions, recipe.dropout.most_points);
        const order = mortonOrder(Float64Array.from(Float32Array.from(points.positions)), seeding.morton_bits);
        this.#initial = initialRates(recipe, this.#options.iterations, unit);
        this.#dropout = dropoutShare(recipe.dropout, views);
        const ordered = selected(points, order);
        const around = await distinctNeighbourhoods(search, ordered.positions, this.#settings.run.min_points);
        signal.throwIfAborted();
        await this.#trainer.begin(train, background, seedDiscs(ordered, around, recipe, seeding));
        signal.throwIfAborted();
        this.#report();
        await this.#listener.onBegin(this.#capture);
        return this.#finish();
    }

    /**
     * Go on with a run that was kept. It gives the same scene as if it had not been interrupted.
     *
     * @param {import("../storage/kept_run.js").Checkpoint} checkpoint
     * @param {AbortSignal} signal ends what comes before the first step
     * @returns {Promise<import("../../page/scene/gaussian_columns.js").GaussianColumns>} the trained scene
     * @throws {Error} the GPU's memory does not hold it, or it was ended
     */
    async goOn(checkpoint, signal) {
        const { train, background } = this.#capture;
        const { header, arrays: [, , ...moments] } = checkpoint;
        [this.#initial, this.#psnr, this.#dropout] = [header.initial, header.psnr, header.dropout ?? 0];
        this.#iteration = header.losses.length;
        this.#first = this.#iteration;
        const { losses, near } = header;
        await this.#trainer.begin(train, background, sceneOf(checkpoint), { losses, near, moments });
        signal.throwIfAborted();
        this.#report();
        return this.#finish();
    }

    /** Draw what is asked for, until `close`. */
    async serve() {
        await this.#waitWhile(() => !this.#isClosed);
    }

    async #finish() {
        this.#capture = null;
        await this.#iterate();
        this.#psnr = await this.#pictures.psnrOf(this.#heldOut);
        this.#report();
        await this.#keep();
        return this.#trainer.download();
    }

    async #iterate() {
        const { iterations, seed } = this.#options;
        const order = new ViewOrder(this.#views, seed);
        const every = this.#settings.run.evaluate_every;
        let began = performance.now();
        while (this.#iteration < iterations && !this.#isStopped) {
            const rates = ratesAt(this.#initial, this.#settings.recipe.schedule, this.#iteration / iterations);
            const dropout = dropoutOfStep(this.#dropout, this.#iteration + 1, seed);
            const isTimeToLook = this.#trainer.step(order.at(this.#iteration), rates, dropout);
            this.#iteration++;
            if (!isTimeToLook && this.#iteration % every && this.#iteration < iterations) {
                continue;
            }
            await this.#trainer.settle();
            this.#spent += performance.now() - began;
            if (this.#iteration % every === 0 && this.#iteration < iterations) {
                this.#psnr = await this.#pictures.psnrOf(this.#heldOut);
            }
            this.#report();
            this.#mustKeep ||= this.#spent > this.#kept + BETWEEN_CHECKPOINTS;
            await this.#doWhatIsAsked();
            await this.#waitWhile(() => this.#isPaused && !this.#isStopped);
            began = performance.now();
        }
    }

    async #keep() {
        [this.#mustKeep, this.#kept] = [false, this.#spent];
        await this.#listener.onCheckpoint(await this.#checkpoint());
    }

    /** How far the run is, or null where there is no room to copy it from the GPU: training goes on without. */
    async #checkpoint() {
        try {
            const [scene, { losses, near, moments }] = [await this.#trainer.download(), await this.#trainer.state()];
            const { count, coefficients } = scene;
            const run = { psnr: this.#psnr, initial: this.#initial, dropout: this.#dropout };
            const header = { count, coefficients, losses, near, ...run };
            return { header, arrays: [scene.shape, scene.sh, ...moments] };
        } catch {
            await this.#trainer.answer();
            return null;
        }
    }

    async #waitWhile(goesOn) {
        while (goesOn()) {
            if (!this.#asked && !this.#mustKeep) {
                await new Promise((resolve) => (this.#wake = resolve));
            }
            await this.#doWhatIsAsked();
        }
    }

    async #doWhatIsAsked() {
        await this.#draw();
        if (this.#mustKeep) {
            await this.#keep();
        }
    }

    async #draw() {
        if (this.#asked) {
            const camera = this.#asked;
            this.#asked = null;
            this.#listener.onPicture(await this.#pictures.of(camera));
        }
    }

    #report() {
        const latest = this.#trainer.losses.slice(-this.#views);
        this.#listener.onProgress({
            iteration: this.#iteration,
            loss: latest.length ? latest.reduce((sum, loss) => sum + loss, 0) / latest.length : null,
            held_out_psnr: this.#psnr,
            rate: this.#spent ? (1000 * (this.#iteration - this.#first)) / this.#spent : 0,
            gaussians: this.#trainer.count,
            bytes: this.#trainer.bytes,
        });
    }
}
