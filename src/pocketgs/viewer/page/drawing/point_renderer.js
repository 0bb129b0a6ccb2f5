/**
 * Renders a scene as points without a GPU: while shaders are compiled, while the scene is loading, and without
 * WebGPU.
 *
 * @module
 */

import { PointImage } from "./point_image.js";
import { Points } from "./points.js";

/**
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("./renderer.js").Picture} Picture
 */

/** Draws on a canvas of its own, which is hidden at first; has the interface of `Renderer`. */
export class PointRenderer {
    #canvas;
    #context;
    #points = null;
    #image = null;

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

    /** @param {Picture} picture */
    draw({ camera, share, background }) {
        if (!this.count) {
            return;
        }
        const { width, height } = camera;
        if (this.#image?.data.width !== width || this.#image.data.height !== height) {
            this.#image = new PointImage(width, height);
            [this.#canvas.width, this.#canvas.height] = [width, height];
        }
        this.#image.draw(this.#points, camera, share, background);
        this.#context.putImageData(this.#image.data, 0, 0);
        this.#canvas.hidden = false;
    }

    /**
     * Draw, and encode the canvas.
     *
     * @param {Picture} picture
     * @returns {Promise<Blob>} a PNG
     */
    photograph(picture) {
        this.draw(picture);
        return new Promise((resolve) => this.#canvas.toBlob(resolve, "image/png"));
    }

    /** Hide the canvas and free its memory, until another scene is set. */
    release() {
        this.#canvas.hidden = true;
        this.#canvas.width = this.#canvas.height = 0;
        this.#points = this.#image = null;
    }
}
