/**
 * A run kept in the browser's own storage, so that it goes on after the page was closed, or killed by the system. Only
 * the last run is kept, by one page at a time.
 *
 * @module
 */

import { GaussianColumns } from "../../page/scene/gaussian_columns.js";

/**
 * @typedef {import("../capture/open.js").Capture} Capture
 * @typedef {import("../training/run.js").Options} Options
 *
 * @typedef {Object} Checkpoint
 * @property {Object} header plain numbers
 * @property {Float32Array[]} arrays
 */

const FOLDER = "run";
const CAPTURE = "capture.json";
const PHOTOGRAPHS = "photographs.bin";
const CHECKPOINT = "checkpoint.bin";
const LOCK = "pocketgs run";
const MS_TO_WAIT = 1000;

/** The folder with the run. Every file is replaced as a whole or not at all. */
export class KeptRun {
    #folder;
    #version;
    #number = "";

    /**
     * @param {FileSystemDirectoryHandle} folder
     * @param {string} version of the site: another one would not go on to the same scene, if at all
     */
    constructor(folder, version) {
        [this.#folder, this.#version] = [folder, version];
    }

    /**
     * Wait for as long as another page keeps a run.
     *
     * @param {string} version of the site
     * @param {() => void} onWait called if that takes long
     * @returns {Promise<KeptRun | null>} null where the browser keeps nothing
     */
    static async open(version, onWait) {
        // A page that is loaded again waits for the worker that it had before.
        const waiting = setTimeout(onWait, MS_TO_WAIT);
        try {
            await lockForGood();
            const root = await navigator.storage.getDirectory();
            return new KeptRun(await root.getDirectoryHandle(FOLDER, { create: true }), version);
        } catch {
            return null;
        } finally {
            clearTimeout(waiting);
        }
    }

    /**
     * Keep another run from now on, instead of the one before, which goes first: there may be no room for both.
     *
     * @param {string} name
     * @param {Capture} capture
     * @param {Options} options
     * @throws {DOMException} there is no room for it: then nothing is kept
     */
    async begin(name, capture, options) {
        await this.#clear();
        this.#number = crypto.randomUUID();
        try {
            await this.#writeCapture(name, capture, options);
        } catch (error) {
            await this.#clear();
            throw error;
        }
    }

    /**
     * Keep how far the run is.
     *
     * @param {Checkpoint} checkpoint
     * @throws {DOMException} there is no room for it: then the checkpoint before stays
     */
    async keep({ header, arrays }) {
        const sizes = arrays.map(({ length }) => length);
        const text = new TextEncoder().encode(JSON.stringify({ number: this.#number, header, sizes }));
        await this.#write(CHECKPOINT, [Uint32Array.of(text.length), text, ...arrays]);
    }

    /**
     * @typedef {Object} Summary
     * @property {string} name
     * @property {number} iteration
     * @property {number} iterations
     * @property {boolean} canGoOn false if the site has changed since
     *
     * @returns {Promise<Summary | null>} of the run that is kept
     */
    async summary() {
        try {
            const { number, version, name, options } = await this.#description();
            const { header } = await readHeader(await this.#file(CHECKPOINT), number);
            const canGoOn = version === this.#version;
            return { name, iteration: header.losses.length, iterations: options.iterations, canGoOn };
        } catch {
            return null;
        }
    }

    /**
     * @returns {Promise<{name: string, capture: Capture, options: Options, checkpoint: Checkpoint}>} the run that
     *     `summary` is of
     */
    async read() {
        const { number, name, options, background, frames, training } = await this.#description();
        const checkpoint = await readCheckpoint(await this.#file(CHECKPOINT), number);
        const photographs = await this.#file(PHOTOGRAPHS);
        let at = 0;
        const take = async (bytes) => {
            at += bytes;
            return new Uint8ClampedArray(await photographs.slice(at - bytes, at).arrayBuffer());
        };
        for (const frame of frames) {
            const pixels = frame.camera.width * frame.camera.height;
            frame.rgba = await take(4 * pixels);
            frame.mask = frame.isMasked ? await take(pixels) : null;
        }
        this.#number = number;
        const [train, heldOut] = [frames.slice(0, training), frames.slice(training)];
        return { name, capture: { train, heldOut, background, cloud: null, warnings: [] }, options, checkpoint };
    }

    async #writeCapture(name, { train, heldOut, background }, options) {
        const frames = [...train, ...heldOut];
        await this.#write(PHOTOGRAPHS, frames.flatMap(({ rgba, mask }) => (mask ? [rgba, mask] : [rgba])));
        const described = frames.map(({ name, camera, hasAlpha, mask }) => {
            return { name, camera, hasAlpha, isMasked: Boolean(mask) };
        });
        const [number, version, training] = [this.#number, this.#version, train.length];
        const content = { number, version, name, options, background, frames: described, training };
        await this.#write(CAPTURE, [JSON.stringify(content)]);
    }

    async #clear() {
        for (const name of [CHECKPOINT, CAPTURE, PHOTOGRAPHS]) {
            await this.#folder.removeEntry(name).catch(() => {});
        }
    }

    async #description() {
        return JSON.parse(await (await this.#file(CAPTURE)).text());
    }

    async #file(name) {
        return (await this.#folder.getFileHandle(name)).getFile();
    }

    /** The file is replaced when it is closed; what was written of one that is not takes room until it is given up. */
    async #write(name, parts) {
        const file = await (await this.#folder.getFileHandle(name, { create: true })).createWritable();
        try {
            for (const part of parts) {
                await file.write(part);
            }
            await file.close();
        } catch (error) {
            await file.abort().catch(() => {});
            throw error;
        }
    }
}

/** Keep other pages from the folder as long as this one is open. */
function lockForGood() {
    return new Promise((resolve, reject) => {
        const holdForGood = () => {
            resolve();
            return new Promise(() => {});
        };
        navigator.locks.request(LOCK, holdForGood).catch(reject);
    });
}

/** The scene as it stood at a checkpoint. @type {(checkpoint: Checkpoint) => GaussianColumns} */
export function sceneOf({ header: { count, coefficients }, arrays: [shape, sh] }) {
    const scene = new GaussianColumns(count, coefficients);
    scene.shape.set(shape);
    scene.sh.set(sh);
    return scene;
}

async function readHeader(file, number) {
    const [length] = new Uint32Array(await file.slice(0, 4).arrayBuffer());
    const { number: found, header, sizes } = JSON.parse(await file.slice(4, 4 + length).text());
    if (found !== number) {
        throw new Error("the kept checkpoint is of another run");
    }
    return { header, sizes, start: 4 + length };
}

async function readCheckpoint(file, number) {
    const { header, sizes, start } = await readHeader(file, number);
    const arrays = [];
    let at = start;
    for (const size of sizes) {
        arrays.push(new Float32Array(await file.slice(at, at + 4 * size).arrayBuffer()));
        at += 4 * size;
    }
    return { header, arrays };
}
