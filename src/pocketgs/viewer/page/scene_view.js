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
 * @typedef {import("./gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("./point_renderer.js").PointRenderer} PointRenderer
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

/** What a frame took, times this, is the pause before the next that only shows more of an arriving scene. */
const PAUSE_BETWEEN_PARTS = 4;

/**
 * Draws a scene whenever something about the picture has changed: as points, until the GPU has drawn it for the first
 * time.
 */
export class SceneView {
    camera = new MovingCamera();
    #canvas;
    #points;
    /** @type {PointRenderer | Renderer} what draws now */
    #renderer;
    /** @type {Renderer | null} */
    #gpu = null;
    /** @type {GaussianColumns | null} */
    #scene = null;
    /** Whether no other renderer will take over soon. */
    #settled = false;
    #rests = true;
    #loop;
    #background = BACKGROUNDS[0];
    #appearance = "splats";
    #times = [];
    #onStatistics;
    #onFault;
    #journey = 0;

    /**
     * @param {HTMLCanvasElement} canvas that the user points at
     * @param {PointRenderer} points
     * @param {{onStatistics: (count: number, framesPerSecond: number) => void, onFault: (text: string) => void}} told
     */
    constructor(canvas, points, { onStatistics, onFault }) {
        this.#canvas = canvas;
        this.#points = this.#renderer = points;
        this.#onStatistics = onStatistics;
        this.#onFault = onFault;
        this.#loop = new FrameLoop(
            (share) => this.#draw(share),
            (took) => this.#count(took),
            (rests) => this.#showBusy(rests),
        );
        new ResizeObserver(() => this.#loop.invalidate()).observe(canvas);
    }

    /** Where what moves the camera has itself called before every frame. */
    get loop() {
        return this.#loop;
    }

    /**
     * Draw on the GPU, once a whole scene is there and its first picture done.
     *
     * @param {Renderer} gpu
     * @throws {Error} the GPU's memory does not hold the scene; then it stays at points
     */
    async useGpu(gpu) {
        this.#gpu = gpu;
        await gpu.setAppearance(shapeOf(this.#appearance));
        await this.#sharpen();
    }

    /** No GPU will take over, for now at least. */
    stayWithPoints() {
        this.#settled = true;
        this.#loop.invalidate();
    }

    /** Milliseconds to let go by before more of an arriving scene is shown, lest drawing hold up what is to come. */
    get pauseBetweenParts() {
        return PAUSE_BETWEEN_PARTS * (this.#times.at(-1) ?? 0);
    }

    /**
     * Show what has arrived of a scene, unless all of it or another is shown already.
     *
     * @param {GaussianColumns} scene
     * @param {number} count of its Gaussians, from the first on
     * @returns {boolean} whether it is shown
     */
    showPart(scene, count) {
        if (this.#renderer !== this.#points || scene === this.#scene) {
            return false;
        }
        this.#points.setScene(scene, count);
        this.#loop.invalidate();
        return true;
    }

    /**
     * @param {GaussianColumns} scene to draw from now on
     * @throws {Error} the GPU's memory does not hold it
     */
    async setScene(scene) {
        this.#scene = scene;
        const isSet = this.#renderer.setScene(scene);
        this.#loop.invalidate();
        await isSet;
        await this.#sharpen();
    }

    /** @param {"splats" | "points" | "discs" | "depth"} appearance to draw Gaussians in from now on */
    async setAppearance(appearance) {
        await this.#gpu?.setAppearance(shapeOf(appearance));
        this.#appearance = appearance;
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
        return { camera, background: this.#background, asDepth: this.#appearance === "depth" };
    }

    async #draw(share) {
        try {
            await this.#renderer.draw(this.#picture(share));
        } catch (error) {
            this.#onFault(error.message);
        }
        if (this.#renderer.count) {
            markOnce("first picture");
        }
    }

    /** Change from points to the GPU if it is there. The loop goes on with points while its first picture is drawn. */
    async #sharpen() {
        if (!this.#scene || !this.#gpu || this.#renderer === this.#gpu) {
            return;
        }
        let picture;
        const start = performance.now();
        try {
            await this.#gpu.setScene(this.#scene);
            picture = this.#picture(1);
            await this.#gpu.draw(picture);
        } catch (error) {
            this.stayWithPoints();
            throw error;
        }
        this.#renderer = this.#gpu;
        this.#points.close();
        markOnce("first sharp picture");
        this.#settled = true;
        this.#showBusy(this.#rests);
        this.#times = [];
        this.#count(performance.now() - start);
        if (JSON.stringify(picture) !== JSON.stringify(this.#picture(1))) {
            this.#loop.invalidate();
        }
    }

    /** @param {boolean} rests whether the loop has nothing to draw */
    #showBusy(rests) {
        this.#rests = rests;
        this.#canvas.setAttribute("aria-busy", String(!rests || !this.#settled));
    }

    #count(took) {
        if (this.#renderer.count === 0) {
            return;
        }
        this.#times = [...this.#times, took].slice(-FRAMES_COUNTED);
        if (this.#settled) {
            const mean = this.#times.reduce((sum, time) => sum + time, 0) / this.#times.length;
            this.#onStatistics(this.#renderer.count, 1000 / mean);
        }
    }
}

/** What shaders draw for an appearance. */
function shapeOf(appearance) {
    return appearance === "depth" ? "splats" : appearance;
}

/** Leave a mark for whoever measures how long it takes until something is to be seen. */
function markOnce(name) {
    if (performance.getEntriesByName(name).length === 0) {
        performance.mark(name);
    }
}
