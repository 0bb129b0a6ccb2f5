/**
 * Following a run, and sending commands to it.
 *
 * @module
 */

import { element } from "../element.js";
import { readScene } from "../formats/scene_file.js";
import { drawCurves } from "./curves.js";
import { showFigures } from "./figures.js";
import { followByPolling } from "./polling.js";
import { followBySocket } from "./socket.js";
import { showStage } from "./stage.js";

/**
 * @typedef {Object} Listener
 * @property {(scene: import("../scene/gaussian_columns.js").GaussianColumns) => void} onScene
 * @property {(viewer: Object) => void} onViewer called with the new content of viewer.json
 * @property {() => void} onResult called when the run has ended unnoticed, and the page has its result instead
 * @property {(text: string) => void} onFault
 */

const SECONDS_TO_RECONNECT = 2;

/** Sockets that may fail, while requests are answered: Safari opens none where a certificate is self-signed. */
const SOCKETS_TO_TRY = 2;

/** Tries in vain after which the page says more. */
const TRIES_TO_EXPLAIN = 5;
const NO_CONNECTION = "no connection to the computer: it may be off, or in another network. This page goes on trying.";

/** Shows a run's progress, and passes on its scenes. */
export class LiveRun {
    #listener;
    #follow = followBySocket;
    #connection;
    #wasOpen = false;
    #socketsFailed = 0;
    #triesFailed = 0;
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
        this.#connection = this.#follow({
            onOpen: () => this.#begin(),
            onMessage: (message) => this.#receive(message),
            onScene: (data) => this.#receiveScene(data),
            onClose: () => this.#lose(),
        });
    }

    #begin() {
        this.#wasOpen = true;
        this.#triesFailed = 0;
        this.#samples = [];
    }

    #receive(message) {
        if (message.type === "progress") {
            this.#show(message);
        } else if (message.type === "cameras") {
            this.#listener.onViewer(message.viewer);
        } else if (message.type === "scene") {
            this.#announced = message;
        }
    }

    #receiveScene(data) {
        this.#latest = { name: `scene.${this.#announced.format}`, data };
        this.#announced = null;
        this.#readLatest();
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

    async #ask(type) {
        try {
            await this.#connection.send(type);
        } catch (error) {
            this.#listener.onFault(error.message);
        }
    }

    #lose() {
        if (!this.#progress.finished || this.#announced) {
            element("live-buttons").hidden = true; // until there is news again
            this.#tryAgain();
        }
    }

    #tryAgain() {
        this.#triesFailed += 1;
        const short = this.#wasOpen ? "connection lost" : "connecting";
        this.#tryLater(this.#triesFailed < TRIES_TO_EXPLAIN ? short : NO_CONNECTION);
    }

    #tryLater(stage) {
        showStage(stage);
        setTimeout(() => this.#reconnect(), 1000 * SECONDS_TO_RECONNECT);
    }

    /** Connect again. A run that has ended meanwhile takes no connections, so what is served is asked for first. */
    async #reconnect() {
        const served = await servedNow();
        if (served === "run") {
            this.#chooseWay();
            this.#connect();
        } else if (served === "result") {
            element("live").hidden = true;
            this.#listener.onResult();
        } else if (served === "nothing") {
            this.#tryLater("ended without a result"); // it may be trained again
        } else {
            this.#tryAgain();
        }
    }

    /** Follow by requests once no socket could be opened although requests are answered. */
    #chooseWay() {
        this.#socketsFailed += this.#wasOpen ? 0 : 1;
        if (this.#socketsFailed === SOCKETS_TO_TRY) {
            this.#follow = followByPolling;
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
