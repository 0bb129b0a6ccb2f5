/**
 * Following a run over a WebSocket, and sending commands to it.
 *
 * @module
 */

import { element } from "../element.js";
import { readScene } from "../formats/scene_file.js";
import { drawCurves } from "./curves.js";
import { showFigures } from "./figures.js";
import { showStage } from "./stage.js";

/**
 * @typedef {Object} Listener
 * @property {(scene: import("../scene/gaussian_columns.js").GaussianColumns) => void} onScene
 * @property {(viewer: Object) => void} onViewer called with the new content of viewer.json
 * @property {() => void} onResult called when the run has ended unnoticed, and the page has its result instead
 * @property {(text: string) => void} onFault
 */

const SECONDS_TO_RECONNECT = 2;

/** Shows a run's progress, and passes on its scenes. */
export class LiveRun {
    #listener;
    #socket;
    #samples = [];
    #progress = {};
    #announced = null;
    #reading = false;
    #latest = null;

    /** @param {Listener} listener */
    constructor(listener) {
        this.#listener = listener;
        element("live").hidden = false;
        element("pause").addEventListener("click", () => this.#ask(this.#progress.paused ? "resume" : "pause"));
        element("stop").addEventListener("click", () => this.#ask("stop"));
        window.addEventListener("resize", () => this.#drawCurves());
        this.#connect();
    }

    #connect() {
        const url = new URL("live", document.baseURI);
        url.protocol = url.protocol.replace("http", "ws");
        this.#socket = new WebSocket(url);
        this.#socket.binaryType = "arraybuffer";
        this.#socket.addEventListener("open", () => (this.#samples = []));
        this.#socket.addEventListener("message", ({ data }) => this.#receive(data));
        this.#socket.addEventListener("close", () => this.#lose());
    }

    #receive(data) {
        if (data instanceof ArrayBuffer) {
            this.#latest = { name: `scene.${this.#announced.format}`, data };
            this.#readLatest();
            return;
        }
        const message = JSON.parse(data);
        if (message.type === "progress") {
            this.#show(message);
        } else if (message.type === "cameras") {
            this.#listener.onViewer(message.viewer);
        } else if (message.type === "scene") {
            this.#announced = message;
        }
    }

    /** Load one scene at a time; of those that arrive meanwhile, only the last is kept. */
    async #readLatest() {
        if (this.#reading) {
            return;
        }
        this.#reading = true;
        while (this.#latest) {
            const { name, data } = this.#latest;
            this.#latest = null;
            try {
                const scene = await readScene(name, new Blob([data]).stream(), data.byteLength);
                await this.#listener.onScene(scene);
            } catch (error) {
                this.#listener.onFault(error.message);
            }
        }
        this.#reading = false;
    }

    #show(progress) {
        this.#progress = progress;
        this.#samples.push(...progress.samples);
        const { paused, finished } = progress;
        showFigures(progress);
        showStage(paused ? "paused" : progress.stage);
        if (finished) {
            element("left").textContent = "done";
        }
        element("pause").textContent = paused ? "Resume" : "Pause";
        element("live-buttons").hidden = finished;
        this.#drawCurves();
    }

    #drawCurves() {
        drawCurves(element("curves"), this.#samples, this.#progress.iterations ?? 0);
    }

    #ask(type) {
        if (this.#socket.readyState === WebSocket.OPEN) {
            this.#socket.send(JSON.stringify({ type }));
        }
    }

    #lose() {
        if (!this.#progress.finished) {
            this.#tryLater("connection lost");
        }
    }

    #tryLater(stage) {
        showStage(stage);
        setTimeout(() => this.#reconnect(), 1000 * SECONDS_TO_RECONNECT);
    }

    /** Connect again. A run that has ended meanwhile takes no connections, so what is served is asked for first. */
    async #reconnect() {
        const served = await servedNow();
        if (served === "run") {
            this.#connect();
        } else if (served === "result") {
            element("live").hidden = true;
            this.#listener.onResult();
        } else if (served === "nothing") {
            element("live-buttons").hidden = true;
            this.#tryLater("ended without a result"); // it may be trained again
        } else {
            this.#tryLater("connection lost");
        }
    }
}

/** @returns {Promise<"run" | "result" | "nothing" | "unknown">} what the page is of now; unknown without an answer */
async function servedNow() {
    try {
        const response = await fetch("viewer.json");
        if (response.ok) {
            return (await response.json()).live ? "run" : "result";
        }
        return response.status === 404 ? "nothing" : "unknown";
    } catch {
        return "unknown";
    }
}
