/**
 * Renders a scene on a canvas with the engine's own passes.
 *
 * @module
 */

import { Description } from "../../gpu/description.js";
import { Executor } from "../../gpu/executor.js";
import { GROWTH, INTERSECTIONS_PER_GAUSSIAN, MEAN, MIN_INTERSECTIONS } from "../constants.js";
import { nearPlane } from "../scene/near_plane.js";
import { Display } from "./display.js";
import { onDevice } from "./opening.js";
import { pngOf } from "./png.js";
import { SubmissionSizes } from "./submission_sizes.js";
import { viewValues } from "./view_values.js";

/**
 * @typedef {import("../scene/camera.js").Camera} Camera
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 *
 * @typedef {Object} Picture parameters of an image
 * @property {Camera} camera
 * @property {boolean} isSharp whether it has the full resolution
 * @property {[number, number, number]} background RGB
 * @property {boolean} asDepth
 *
 * @typedef {Object} Passes
 * @property {"splats" | "points" | "discs"} appearance of Gaussians
 * @property {string | null} weights the form of those that are drawn without sorting
 */

/** Times taken say nothing of a scene with more than so many times the Gaussians. */
const MUCH_LARGER = 2;

/** How often the host waits while splats are listed in parts: a browser may take 100 ms each time. */
const WAITS = 3;

/** Descriptions of passes by their address, so that a lost GPU can be opened again when the server is gone. */
const DESCRIPTIONS = new Map();

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
    /** Number of tasks that wait for it. */
    #waiting = 0;
    #sizes = new SubmissionSizes();

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
        return onDevice(async (device) => {
            device.addEventListener("uncapturederror", ({ error }) => onFault(error.message));
            [renderer.#device, renderer.#canvas] = [device, canvas];
            [renderer.#display, renderer.#executor] = await Promise.all([
                Display.open(device, canvas),
                renderer.#executorOf(await description),
            ]);
            return renderer;
        });
    }

    /** @returns {Promise<GPUDeviceLostInfo>} resolves when the GPU is lost */
    get lost() {
        return this.#device.lost;
    }

    /** Number of Gaussians of the scene. */
    get count() {
        return this.#scene?.count ?? 0;
    }

    /** Whether nothing is known of how long an image of the scene takes. */
    get isUntried() {
        return this.#sizes.isUntried;
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
     * @param {() => boolean} isWanted asked now and then; drawing ends early once it is not, or another task waits
     * @returns {Promise<boolean>} whether it is complete
     */
    draw(picture, isWanted = () => true) {
        return this.#inTurn(() => this.#draw(picture, () => isWanted() && !this.#waiting));
    }

    /**
     * Draw, and encode the canvas.
     *
     * @param {Picture} picture
     * @returns {Promise<Blob>} a PNG
     */
    photograph(picture) {
        return this.#inTurn(async () => {
            await this.#draw(picture, () => true);
            // In the same task as the drawing: later the canvas may be cleared.
            return pngOf(this.#canvas);
        });
    }

    #inTurn(task) {
        this.#waiting++;
        const done = this.#busy.then(() => {
            this.#waiting--;
            return task();
        });
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
            if (scene?.count > MUCH_LARGER * this.count) {
                this.#sizes = new SubmissionSizes();
            }
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
        [this.#executor, this.#passes, this.#sizes] = [executor, passes, new SubmissionSizes()];
    }

    async #upload(scene, executor) {
        if (!scene) {
            return;
        }
        const expected = INTERSECTIONS_PER_GAUSSIAN * scene.count;
        const intersections = Math.max(this.#intersections, MIN_INTERSECTIONS, expected);
        const symbols = symbolsOf(executor.description, [1, 1], scene, intersections);
        this.#reserved.clear();
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

    async #draw({ camera, background, asDepth }, isWanted) {
        if (!this.#scene) {
            return true;
        }
        const start = performance.now();
        const drawing = { camera, behind: asDepth ? [0, 0, 0] : background, suffix: asDepth ? " depth" : "" };
        const pixels = camera.width * camera.height;
        const waits = this.#sizes.mayDrawWhole(pixels)
            ? await this.#drawWhole(drawing)
            : await this.#drawInParts(drawing, isWanted);
        if (waits) {
            this.#sizes.imageTook(pixels, performance.now() - start, waits);
            const how = { background, asDepth, near: this.#near };
            this.#display.show(this.#executor.buffer("image"), camera, this.#canvas, how);
        }
        return waits > 0;
    }

    /** Returns how often it waited for the GPU. */
    async #drawWhole(drawing) {
        await this.#whileThereIsRoom(drawing, async (symbols) => {
            this.#executor.submit(`render${drawing.suffix}`, symbols);
            return true;
        });
        return 1;
    }

    /** Draw in submissions of bounded duration. Returns how often it waited, or 0 if it was not wanted to the end. */
    async #drawInParts(drawing, isWanted) {
        const list = (symbols) => this.#executor.submitByPass("list splats", symbols, WAITS, isWanted);
        if (!(await this.#whileThereIsRoom(drawing, list))) {
            return 0;
        }
        let waits = WAITS + 1;
        const symbols = this.#symbolsOf(drawing.camera, this.#intersections);
        for (let first = 0, tiles; first < symbols.tiles; first += tiles) {
            tiles = Math.min(this.#sizes.tiles, symbols.tiles - first);
            const start = performance.now();
            this.#writeView(drawing, symbols, first);
            this.#executor.submit(`draw tiles${drawing.suffix}`, { ...symbols, drawn_tiles: tiles });
            await this.#executor.finished();
            this.#sizes.partTook(tiles, performance.now() - start);
            waits++;
            if (!isWanted()) {
                return 0;
            }
        }
        return waits;
    }

    /** Submit passes, again with more room for as long as they run out of it. Returns what `submit` returns. */
    async #whileThereIsRoom(drawing, submit) {
        let intersections = this.#intersections;
        for (;;) {
            const symbols = this.#symbolsOf(drawing.camera, intersections);
            await this.#makeRoom(symbols);
            this.#writeView(drawing, symbols, 0);
            const isComplete = await submit(symbols);
            const [, halted, needed] = await this.#executor.read("status", Uint32Array, 3);
            if (halted) {
                intersections = Math.ceil(needed * GROWTH);
                this.#executor.write("status", new Uint32Array(3));
            }
            if (!halted || !isComplete) {
                return isComplete;
            }
        }
    }

    #symbolsOf({ width, height }, intersections) {
        return symbolsOf(this.#executor.description, [width, height], this.#scene, intersections);
    }

    #writeView({ camera, behind }, symbols, firstTile) {
        const values = viewValues(camera, behind, this.#near, symbols);
        this.#executor.writeUniform("view", { ...values, first_tile: firstTile });
    }

    /** Grow the buffers, if they have never been large enough. */
    async #makeRoom(symbols) {
        const key = JSON.stringify(symbols);
        if (!this.#reserved.has(key)) {
            const known = this.#reserved;
            this.#reserved = new Set();
            await this.#executor.reserve(this.#executor.description.sizes(symbols));
            this.#reserved = known.add(key);
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
        photographs: 0,
        collecting: 0,
    });
}

/** Points and discs are opaque and hide each other, so those of any scene are sorted. @returns {Passes} */
function passesFor(scene, appearance) {
    return { appearance, weights: appearance === "splats" ? (scene?.weighting?.form ?? null) : null };
}

/** @param {Passes} passes */
async function fetchDescription({ appearance, weights }) {
    const address = `passes.json?appearance=${appearance}${weights ? `&weights=${weights}` : ""}`;
    if (!DESCRIPTIONS.has(address)) {
        const response = await fetch(address);
        if (!response.ok) {
            throw new Error(`passes.json: the server answers ${response.status}`);
        }
        DESCRIPTIONS.set(address, new Description(await response.json()));
    }
    return DESCRIPTIONS.get(address);
}
