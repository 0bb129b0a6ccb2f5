/**
 * The view of a scene on the canvas: camera, scene and appearance.
 *
 * @module
 */

import { MovingCamera, between, lensBetween } from "../scene/camera.js";
import { FrameLoop } from "./frame_loop.js";
import { SceneRenderer } from "./scene_renderer.js";

/**
 * @typedef {import("../scene/camera.js").Camera} Camera
 * @typedef {import("../scene/camera.js").Pose} Pose
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("./point_renderer.js").PointRenderer} PointRenderer
 *
 * @typedef {Object} Statistics
 * @property {number} count of Gaussians
 * @property {string} compositor how they come together in an image
 * @property {number} bytes size of the scene's file, or 0
 * @property {number} milliseconds mean duration of the last frames
 */

/** Duration of the animation from one camera to another, in seconds. */
const JOURNEY = 0.7;

const BACKGROUNDS = [
    [0, 0, 0],
    [0.5, 0.5, 0.5],
    [1, 1, 1],
];

/** Number of frames that the frame time is averaged over. */
const FRAMES_COUNTED = 20;

/** Pause before the next frame of a loading scene, as a multiple of the last frame's duration. */
const PAUSE_BETWEEN_PARTS = 4;

/** Draws a scene whenever the view changes. */
export class SceneView {
    camera = new MovingCamera();
    #canvas;
    #renderer;
    #rests = true;
    /** Number of pending tasks besides drawing. */
    #underWay = 0;
    #loop;
    #background = BACKGROUNDS[0];
    /** Whether the user has chosen it. */
    #isBackgroundChosen = false;
    #appearance = "splats";
    #times = [];
    #onStatistics;
    #journey = 0;
    /** Numbers of what was opened: of the last, and of what is shown. */
    #opened = 0;
    #shown = 0;

    /**
     * @param {HTMLCanvasElement} canvas that receives pointer events
     * @param {PointRenderer} points
     * @param {{
     *     onStatistics: (found: Statistics) => void, onNote: (text: string) => void, onFault: (text: string) => void,
     * }} told
     */
    constructor(canvas, points, { onStatistics, onNote, onFault }) {
        this.#canvas = canvas;
        this.#onStatistics = onStatistics;
        this.#renderer = new SceneRenderer(points, {
            pictureNow: (share) => this.#picture(share),
            onChange: () => this.#loop.invalidate(),
            onTakeOver: () => {
                this.#times = [];
                this.#loop.beginAnew();
            },
            onRegaining: (done) => this.busyUntil(done),
            onNote,
            onFault,
        });
        this.#loop = new FrameLoop(
            (share, isWanted) => this.#renderer.draw(this.#picture(share), isWanted),
            (took) => this.#count(took),
            (rests) => {
                this.#rests = rests;
                this.#showBusy();
            },
        );
        new ResizeObserver(() => this.#loop.invalidate()).observe(canvas);
    }

    /** The frame loop, in which camera movers register. */
    get loop() {
        return this.#loop;
    }

    /** The renderer, with or without a GPU. */
    get renderer() {
        return this.#renderer;
    }

    /**
     * Show the busy state until a task is done, as during drawing.
     *
     * @param {Promise<unknown>} work that will change the image
     */
    async busyUntil(work) {
        this.#underWay++;
        this.#showBusy();
        try {
            await work;
        } finally {
            this.#underWay--;
            this.#showBusy();
        }
    }

    /** Milliseconds to wait before showing more of a loading scene, so that drawing does not delay loading. */
    get pauseBetweenParts() {
        return PAUSE_BETWEEN_PARTS * (this.#times.at(-1) ?? 0);
    }

    /**
     * Start opening a scene, or a run with a sequence of scenes.
     *
     * @returns {() => boolean} claims the view, to be called before showing it: false if something opened later has it
     */
    beginOpening() {
        const number = ++this.#opened;
        return () => {
            const isNewest = number >= this.#shown;
            this.#shown = Math.max(this.#shown, number);
            return isNewest;
        };
    }

    /**
     * Set the scene.
     *
     * @param {GaussianColumns} scene
     */
    setScene(scene) {
        return this.busyUntil(this.#renderer.setScene(scene));
    }

    /** @param {"splats" | "points" | "discs" | "depth"} appearance of Gaussians */
    async setAppearance(appearance) {
        await this.#renderer.setAppearance(shapeOf(appearance));
        this.#appearance = appearance;
        this.#loop.invalidate();
    }

    /**
     * Set the background, unless the user has chosen one.
     *
     * @param {[number, number, number]} background RGB
     */
    setBackground(background) {
        if (!this.#isBackgroundChosen) {
            this.#background = background;
            this.#loop.invalidate();
        }
    }

    /** Switch to the next of black, grey and white. */
    changeBackground() {
        const at = BACKGROUNDS.findIndex((background) => background.every((c, i) => c === this.#background[i]));
        this.#background = BACKGROUNDS[(at + 1) % BACKGROUNDS.length];
        this.#isBackgroundChosen = true;
        this.#loop.invalidate();
    }

    /** Stop the animation, since the user has moved the camera. */
    moved() {
        this.#journey++;
        this.#loop.move();
    }

    /**
     * Go to a pose, at once or animated.
     *
     * @param {Pose} pose
     * @param {Camera} lens camera whose field of view is shown
     * @param {boolean} atOnce
     */
    goTo(pose, lens, atOnce = false) {
        const [from, fromLens] = [this.camera.pose, this.camera.lens];
        const journey = ++this.#journey;
        if (atOnce || matchMedia("(prefers-reduced-motion: reduce)").matches) {
            [this.camera.pose, this.camera.lens] = [pose, lens];
            this.#loop.invalidate();
            return;
        }
        let gone = 0;
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

    /** @returns {Promise<Blob>} the current image as a PNG */
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
        const scaled = Math.min(share, this.#renderer.largestShare);
        const camera = this.camera.of(...size.map((side) => Math.max(1, Math.round(scaled * side))));
        return { camera, isSharp: share === 1, background: this.#background, asDepth: this.#appearance === "depth" };
    }

    #showBusy() {
        this.#canvas.setAttribute("aria-busy", String(!this.#rests || this.#underWay > 0));
    }

    #count(took) {
        if (this.#renderer.count === 0) {
            return;
        }
        this.#times = [...this.#times, took].slice(-FRAMES_COUNTED);
        if (this.#renderer.isSettled) {
            const mean = this.#times.reduce((sum, time) => sum + time, 0) / this.#times.length;
            const { count, compositor, fileBytes } = this.#renderer;
            this.#onStatistics({ count, compositor, bytes: fileBytes, milliseconds: mean });
        }
    }
}

/** The shaders' name for an appearance. */
function shapeOf(appearance) {
    return appearance === "depth" ? "splats" : appearance;
}
