/**
 * Shows a run: stage, curves, figures.
 *
 * @module
 */

import { drawCurves } from "../../page/live/curves.js";
import { showFigures } from "../../page/live/figures.js";

/** The card on the left. */
export class ProgressView {
    #iterations = 0;
    #samples = [];

    constructor() {
        window.addEventListener("resize", () => this.#draw());
    }

    /**
     * A run begins.
     *
     * @param {number} iterations
     */
    begin(iterations) {
        [this.#iterations, this.#samples] = [iterations, []];
        element("live").hidden = false;
        element("live-buttons").hidden = false;
        element("saving").hidden = true;
        element("pause").textContent = "Pause";
        for (const id of ["loss", "psnr", "left", "memory"]) {
            element(id).textContent = "–";
        }
        element("stats").textContent = element("iteration").textContent = "";
        for (const id of ["pause", "stop"]) {
            element(id).disabled = true;
        }
        this.#draw();
    }

    /** What is done before training. @type {(text: string, share?: number) => void} */
    showStage(text, share = 0) {
        element("stage").textContent = text;
        element("training").value = share;
    }

    /** @param {import("../training/run.js").Progress} progress */
    showProgress({ iteration, loss, held_out_psnr, rate, gaussians, bytes }) {
        for (const id of ["pause", "stop"]) {
            element(id).disabled = false;
        }
        this.#samples.push({ iteration, loss, held_out_psnr });
        const iterations = this.#iterations;
        const seconds_left = rate ? (iterations - iteration) / rate : null;
        element("stage").textContent = "training";
        showFigures({ iteration, iterations, loss, held_out_psnr, seconds_left, memory_mb: bytes / 1e6 });
        element("stats").textContent = `${gaussians.toLocaleString("en")} splats`;
        this.#draw();
    }

    /** The run has ended. */
    end() {
        element("stage").textContent = "done";
        element("left").textContent = "done";
        element("live-buttons").hidden = true;
        element("saving").hidden = false;
    }

    #draw() {
        drawCurves(element("curves"), this.#samples, this.#iterations);
    }
}

function element(id) {
    return document.getElementById(id);
}
