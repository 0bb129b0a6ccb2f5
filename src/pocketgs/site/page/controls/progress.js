/**
 * Shows a run: stage, curves, figures.
 *
 * @module
 */

import { element } from "../../page/element.js";
import { drawCurves } from "../../page/live/curves.js";
import { showFigures } from "../../page/live/figures.js";
import { showStage } from "../../page/live/stage.js";
import { keepFocusIn } from "./focus.js";

/** The card on the left. */
export class ProgressView {
    #stage = "training";
    #iterations = 0;
    #samples = [];

    constructor() {
        window.addEventListener("resize", () => this.#draw());
        // On phones the pictures are below this card.
        const rest = document.documentElement.style;
        const place = () => rest.setProperty("--live-height", `${element("live").offsetHeight}px`);
        new ResizeObserver(place).observe(element("live"));
    }

    /**
     * A run begins.
     *
     * @param {number} iterations
     */
    begin(iterations) {
        [this.#stage, this.#iterations, this.#samples] = ["training", iterations, []];
        element("live").hidden = false;
        element("cancel").hidden = false;
        element("live-buttons").hidden = true;
        element("saving").hidden = true;
        element("pause").textContent = "Pause";
        for (const id of ["loss", "psnr", "left", "memory"]) {
            element(id).textContent = "–";
        }
        for (const id of ["stats", "iteration", "plan"]) {
            element(id).textContent = "";
        }
        keepFocusIn(element("live"));
        this.#draw();
    }

    /**
     * What is done before training.
     *
     * @param {string} text
     * @param {number} share
     * @param {number} bytes of the GPU's buffers
     */
    showWork(text, share, bytes = 0) {
        showStage(text);
        element("training").value = share;
        if (bytes) {
            element("memory").textContent = `${Math.round(bytes / 1e6)} MB`;
        }
    }

    /** What the run will take. @type {(text: string) => void} */
    showPlan(text) {
        element("plan").textContent = text;
    }

    /** @param {import("../training/run.js").Progress} progress */
    showProgress({ iteration, loss, held_out_psnr, rate, gaussians, bytes }) {
        if (element("live-buttons").hidden) {
            element("cancel").hidden = true;
            element("live-buttons").hidden = false;
            keepFocusIn(element("live"));
        }
        this.#samples.push({ iteration, loss, held_out_psnr });
        const iterations = this.#iterations;
        const seconds_left = rate ? (iterations - iteration) / rate : null;
        showStage(this.#stage);
        showFigures({ iteration, iterations, loss, held_out_psnr, seconds_left, memory_mb: bytes / 1e6 });
        element("stats").textContent = `${gaussians.toLocaleString("en")} splats`;
        this.#draw();
    }

    /** Pause, or go on. @returns {boolean} whether the run is to pause */
    pause() {
        const isPaused = this.#stage === "training";
        showStage((this.#stage = isPaused ? "paused" : "training"));
        element("pause").textContent = isPaused ? "Resume" : "Pause";
        return isPaused;
    }

    /** The run has ended. */
    end() {
        showStage("done");
        element("left").textContent = "done";
        element("live-buttons").hidden = true;
        element("saving").hidden = false;
        keepFocusIn(element("live"));
    }

    #draw() {
        drawCurves(element("curves"), this.#samples, this.#iterations);
    }
}
