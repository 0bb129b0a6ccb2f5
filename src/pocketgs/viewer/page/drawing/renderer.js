/**
 * Renders a scene on a canvas with the engine's own passes.
 *
 * @module
 */

import { Description } from "../../gpu/description.js";
import { BUFFER_LIMITS, openDevice } from "../../gpu/device.js";
import { Executor } from "../../gpu/executor.js";
import { MEAN } from "../scene/gaussian_columns.js";
import { nearPlane } from "../scene/near_plane.js";
import { Display } from "./display.js";
import { viewValues } from "./view_values.js";

/**
 * @typedef {import("../scene/camera.js").Camera} Camera
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 *
 * @typedef {Object} Picture parameters of an image
 * @property {Camera} camera
 * @property {number} share of the full resolution
 * @property {[number, number, number]} background RGB
 * @property {boolean} asDepth
 *
 * @typedef {Object} Passes
 * @property {"splats" | "points" | "discs"} appearance of Gaussians
 * @property {string | null} weights the form of those that are drawn without sorting
 */

/** Initial capacity for tile intersections, and its growth: as in `engine.py`. */
const INTERSECTIONS_PER_GAUSSIAN = 8;
const MIN_INTERSECTIONS = 1 << 16;
const GROWTH = 1.25;

/** Holds the device and its buffers. */
export class Renderer {
    /** @type {GPUDevice} */
    #device;
    #canvas;
    #display;
    /** @type {Executor} */
    #executor;
    /** What the executor's passes draw. @type {Passes} */
    #passes = { appearance: "splats", weights: null };
    /** @type {GaussianColumns | null} */
    #scene = null;
    #intersections = 0;
    #near = 0;
    /** Maximum sizes of images that the buffers have room for. */
    #reserved = new Set();
    /** The current task: two at once would replace each other's buffers. */
    #busy = Promise.resolve();

    /**
     * Open the GPU for a canvas, and compile the shaders.
     *
     * @param {HTMLCanvasElement} canvas
     * @param {(message: string) => void} onFault called with later errors, except the loss of the GPU
     * @returns {Promise<Renderer>}
     * @throws {Error} there is no WebGPU, or no GPU
     */
    static async open(canvas, onFault) {
        const renderer = new Renderer();
        const description = fetchDescription(renderer.#passes);
        description.catch(() => {});
        renderer.#device = await openDevice(BUFFER_LIMITS);
        renderer.#device.addEventListener("uncapturederror", ({ error }) => onFault(error.message));
        renderer.#canvas = canvas;
        [renderer.#display, renderer.#executor] = await Promise.all([
            Display.open(renderer.#device, canvas),
            renderer.#executorOf(await description),
        ]);
        return renderer;
    }

    /** @returns {Promise<GPUDeviceLostInfo>} resolves when the GPU is lost */
    get lost() {
        return this.#device.lost;
    }

    /** Number of Gaussians of the scene. */
    get count() {
        return this.#scene?.count ?? 0;
    }

    /**
     * Set the scene.
     *
     * @param {GaussianColumns} scene
     * @throws {Error} it does not fit in the GPU's memory
     */
    setScene(scene) {
        return this.#inTurn(async () => {
            await this.#show(scene, this.#passes.appearance);
            this.#scene = scene;
        });
    }

    /**
     * Set the appearance of Gaussians.
     *
     * @param {"splats" | "points" | "discs"} appearance
     */
    setAppearance(appearance) {
        return this.#inTurn(async () => {
            if (appearance !== this.#passes.appearance) {
                await this.#show(this.#scene, appearance);
            }
        });
    }

    /**
     * Draw on the canvas, whose size may differ from the camera's image. The canvas changes when the image is complete.
     *
     * @param {Picture} picture
     * @returns {Promise<void>}
     */
    draw(picture) {
        return this.#inTurn(() => this.#draw(picture));
    }

    /**
     * Draw, and encode the canvas.
     *
     * @param {Picture} picture
     * @returns {Promise<Blob>} a PNG
     */
    photograph(picture) {
        return this.#inTurn(async () => {
            await this.#draw(picture);
            // In the same task as the drawing: later the canvas may be cleared.
            return new Promise((resolve) => this.#canvas.toBlob(resolve, "image/png"));
        });
    }

    #inTurn(task) {
        const done = this.#busy.then(task);
        this.#busy = done.catch(() => {});
        return done;
    }

    async #executorOf(description) {
        const executor = new Executor(this.#device, description);
        await executor.prepare();
        return executor;
    }

    /** Change to the passes for a scene, if others are there, and upload it. The old ones stay if the upload fails. */
    async #show(scene, appearance) {
        const passes = passesFor(scene, appearance);
        if (JSON.stringify(passes) === JSON.stringify(this.#passes)) {
            await this.#upload(scene, this.#executor);
            return;
        }
        const executor = await this.#executorOf(await fetchDescription(passes));
        try {
            await this.#upload(scene, executor);
        } catch (error) {
            executor.destroy();
            throw error;
        }
        this.#executor.destroy();
        [this.#executor, this.#passes] = [executor, passes];
    }

    async #upload(scene, executor) {
        if (!scene) {
            return;
        }
        const expected = INTERSECTIONS_PER_GAUSSIAN * scene.count;
        const intersections = Math.max(this.#intersections, MIN_INTERSECTIONS, expected);
        const symbols = symbolsOf(executor.description, [1, 1], scene, intersections);
        await executor.reserve(executor.description.sizes(symbols));
        executor.write("shape", scene.shape);
        executor.write("sh", scene.sh);
        if (executor.description.uniforms.weighting) {
            executor.write("views", scene.weighting.views);
            executor.writeUniform("weighting", scene.weighting.uniform);
        }
        // No bounds hold of a scene that has not been drawn.
        executor.write("cluster_bounds", new Uint8Array(executor.buffer("cluster_bounds").size));
        executor.write("status", new Uint32Array(3));
        this.#near = nearPlane([0, 1, 2].map((axis) => scene.column(MEAN + axis)), scene.count);
        this.#intersections = intersections;
        this.#reserved = new Set([JSON.stringify(symbols)]);
    }

    async #draw({ camera, background, asDepth }) {
        if (!this.#scene) {
            return;
        }
        const sequence = asDepth ? "render depth" : "render";
        const behind = asDepth ? [0, 0, 0] : background;
        let intersections = this.#intersections;
        for (;;) {
            const symbols = symbolsOf(this.#executor.description, [camera.width, camera.height], this.#scene, intersections);
            await this.#makeRoom(symbols);
            this.#executor.writeUniform("view", viewValues(camera, behind, this.#near, symbols));
            this.#executor.submit(sequence, symbols);
            const [, halted, needed] = await this.#executor.read("status", Uint32Array, 3);
            if (!halted) {
                break;
            }
            intersections = Math.ceil(needed * GROWTH);
            this.#resume();
        }
        this.#display.show(this.#executor.buffer("image"), camera, this.#canvas, background, asDepth);
    }

    /** Grow the buffers after the passes ran out of room. */
    #resume() {
        this.#executor.write("status", new Uint32Array(3));
    }

    async #makeRoom(symbols) {
        const key = JSON.stringify(symbols);
        if (!this.#reserved.has(key)) {
            await this.#executor.reserve(this.#executor.description.sizes(symbols));
            this.#reserved.add(key);
            this.#intersections = symbols.intersections;
        }
    }
}

/** The numbers that the passes of one image of a scene depend on. */
function symbolsOf(description, [width, height], { count, coefficients, weighting }, intersections) {
    return description.symbols({
        gaussians: count,
        capacity: count,
        coefficients,
        view_coefficients: weighting?.coefficients ?? 0,
        width,
        height,
        intersections,
        photograph_pixels: 0,
        replay_depth: 0,
        structural: 0,
        regularised: 0,
        colours_learned: 0,
        photographs: 0,
        collecting: 0,
        listed: 0,
    });
}

/** Points and discs are opaque and hide each other, so those of any scene are sorted. @returns {Passes} */
function passesFor(scene, appearance) {
    return { appearance, weights: appearance === "splats" ? (scene?.weighting?.form ?? null) : null };
}

/** @param {Passes} passes */
async function fetchDescription({ appearance, weights }) {
    const response = await fetch(`passes.json?appearance=${appearance}${weights ? `&weights=${weights}` : ""}`);
    if (!response.ok) {
        throw new Error(`passes.json: the server answers ${response.status}`);
    }
    return new Description(await response.json());
}
