/**
 * Renders a scene as points without a GPU: while shaders are compiled, while the scene is loading, and without
 * WebGPU.
 *
 * @module
 */

import { pngOf } from "./png.js";
import { PointImage } from "./point_image.js";
import { Points } from "./points.js";

/**
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("./renderer.js").Picture} Picture
 */

/** Milliseconds of drawing after which the page gets its turn. */
const TURN = 12;

/** Draws on a canvas of its own, which is hidden at first; has the interface of `Renderer`. */
export class PointRenderer {
    #canvas;
    #context;
    #points = null;
    #image = null;
    /** The current task: two at once would draw into one image. */
    #busy = Promise.resolve();

    /** @param {HTMLCanvasElement} canvas */
    constructor(canvas) {
        this.#canvas = canvas;
        this.#context = canvas.getContext("2d", { alpha: false });
    }

    /** Number of points. */
    get count() {
        return this.#points?.count ?? 0;
    }

    /**
     * Set the scene, or show more of the same scene.
     *
     * @param {GaussianColumns} scene
     * @param {number} count number of its Gaussians that have arrived
     */
    setScene(scene, count = scene.count) {
        if (!this.#points?.areOf(scene)) {
            this.#points = new Points(scene);
        }
        this.#points.extendTo(count);
    }

    /**
     * Draw. The canvas changes when the image is complete.
     *
     * @param {Picture} picture
     * @param {() => boolean} isWanted asked now and then; drawing ends early once it is not
     * @returns {Promise<boolean>} whether it is complete
     */
    draw(picture, isWanted = () => true) {
        const done = this.#busy.then(() => this.#draw(picture, isWanted));
        this.#busy = done.catch(() => {});
        return done;
    }

    /**
     * Draw, and encode the canvas.
     *
     * @param {Picture} picture
     * @returns {Promise<Blob>} a PNG
     */
    async photograph(picture) {
        await this.draw(picture);
        return pngOf(this.#canvas);
    }

    /** Hide the canvas and free its memory, until another scene is set. */
    release() {
        this.#canvas.hidden = true;
        this.#canvas.width = this.#canvas.height = 0;
        this.#points = this.#image = null;
    }

    async #draw({ camera, background }, isWanted) {
        const points = this.#points;
        if (!this.count) {
            return true;
        }
        const { width, height } = camera;
        if (this.#image?.data.width !== width || this.#image.data.height !== height) {
            this.#image = new PointImage(width, height);
        }
        const image = this.#image;
        let turn = performance.now();
        for (const _ of image.draw(points, camera, background)) {
            if (performance.now() - turn > TURN) {
                await new Promise((resolve) => setTimeout(resolve));
                if (!isWanted() || points !== this.#points) {
                    return false;
                }
                turn = performance.now();
            }
        }
        [this.#canvas.width, this.#canvas.height] = [width, height];
        this.#context.putImageData(image.data, 0, 0);
        this.#canvas.hidden = false;
        return true;
    }
}
