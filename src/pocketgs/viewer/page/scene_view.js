/**
 * The picture on the canvas: from where, of what, and how it appears.
 *
 * @module
 */

import { MovingCamera, between, lensBetween } from "./camera.js";
import { FrameLoop } from "./frame_loop.js";

/**
 * @typedef {import("./camera.js").Camera} Camera
 * @typedef {import("./camera.js").Pose} Pose
 * @typedef {import("./renderer.js").Renderer} Renderer
 */

/** Seconds of the way from one camera to another. */
const JOURNEY = 0.7;

const BACKGROUNDS = [
    [0, 0, 0],
    [0.5, 0.5, 0.5],
    [1, 1, 1],
];

/** Frames whose mean length is shown. */
const FRAMES_COUNTED = 20;

/** Draws a scene whenever something about the picture has changed. */
export class SceneView {
    camera = new MovingCamera();
    #canvas;
    #renderer;
    #loop;
    #background = BACKGROUNDS[0];
    #asDepth = false;
    #times = [];
    #onStatistics;
    #onFault;
    #journey = 0;

    /**
     * @param {HTMLCanvasElement} canvas
     * @param {Renderer} renderer
     * @param {{onStatistics: (count: number, framesPerSecond: number) => void, onFault: (text: string) => void}} told
     */
    constructor(canvas, renderer, { onStatistics, onFault }) {
        this.#canvas = canvas;
        this.#renderer = renderer;
        this.#onStatistics = onStatistics;
        this.#onFault = onFault;
        this.#loop = new FrameLoop(
            (share) => this.#draw(share),
            (took) => this.#count(took),
            (rests) => canvas.setAttribute("aria-busy", String(!rests)),
        );
        new ResizeObserver(() => this.#loop.invalidate()).observe(canvas);
    }

    /** Where what moves the camera has itself called before every frame. */
    get loop() {
        return this.#loop;
    }

    /** @param {import("./gaussian_columns.js").GaussianColumns} scene to draw from now on */
    async setScene(scene) {
        await this.#renderer.setScene(scene);
        this.#loop.invalidate();
    }

    /** @param {"splats" | "points" | "discs" | "depth"} appearance to draw Gaussians in from now on */
    async setAppearance(appearance) {
        const asDepth = appearance === "depth";
        await this.#renderer.setAppearance(asDepth ? "splats" : appearance);
        this.#asDepth = asDepth;
        this.#loop.invalidate();
    }

    /** @param {[number, number, number]} background RGB */
    setBackground(background) {
        this.#background = background;
        this.#loop.invalidate();
    }

    /** The next of black, grey and white. */
    changeBackground() {
        const at = BACKGROUNDS.findIndex((background) => background.every((c, i) => c === this.#background[i]));
        this.setBackground(BACKGROUNDS[(at + 1) % BACKGROUNDS.length]);
    }

    /** The camera has been moved by hand, which ends a journey. */
    moved() {
        this.#journey++;
        this.#loop.move();
    }

    /**
     * Go to a pose, at once or on a journey.
     *
     * @param {Pose} pose
     * @param {Camera} lens whose field of view to show
     * @param {boolean} atOnce
     */
    goTo(pose, lens, atOnce = false) {
        const [from, fromLens] = [this.camera.pose, this.camera.lens];
        const journey = ++this.#journey;
        let gone = atOnce || matchMedia("(prefers-reduced-motion: reduce)").matches ? 1 : 0;
        this.#loop.addMover((seconds) => {
            if (journey !== this.#journey) {
                return false;
            }
            gone = Math.min(1, gone + seconds / JOURNEY);
            const share = gone * gone * (3 - 2 * gone);
            this.camera.pose = gone === 1 ? pose : between(from, pose, share);
            this.camera.lens = gone === 1 ? lens : lensBetween(fromLens, lens, share);
            return gone < 1;
        });
    }

    /** @returns {Promise<Blob>} the picture as it is now, as a PNG */
    photograph() {
        return this.#renderer.photograph(this.#picture(1));
    }

    #picture(share) {
        const [width, height] = [this.#canvas.clientWidth, this.#canvas.clientHeight];
        const scale = window.devicePixelRatio;
        const size = [width, height].map((side) => Math.max(1, Math.round(side * scale)));
        if (this.#canvas.width !== size[0] || this.#canvas.height !== size[1]) {
            [this.#canvas.width, this.#canvas.height] = size;
        }
        const camera = this.camera.of(...size.map((side) => Math.max(1, Math.round(share * side))));
        return { camera, background: this.#background, asDepth: this.#asDepth };
    }

    async #draw(share) {
        try {
            await this.#renderer.draw(this.#picture(share));
        } catch (error) {
            this.#onFault(error.message);
        }
    }

    #count(took) {
        if (this.#renderer.count === 0) {
            return;
        }
        this.#times = [...this.#times, took].slice(-FRAMES_COUNTED);
        const mean = this.#times.reduce((sum, time) => sum + time, 0) / this.#times.length;
        this.#onStatistics(this.#renderer.count, 1000 / mean);
    }
}
