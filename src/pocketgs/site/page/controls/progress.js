/**
 * Shows a run: stage, curves, figures.
 *
 * @module
 */

import { drawCurves } from "../../page/live/curves.js";

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
        element("stage").textContent = "training";
        element("iteration").textContent = `${iteration} / ${this.#iterations}`;
        element("training").value = iteration / this.#iterations;
        element("loss").textContent = loss?.toPrecision(3) ?? "–";
        element("psnr").textContent = held_out_psnr === null ? "–" : `${held_out_psnr.toFixed(2)} dB`;
        element("left").textContent = rate ? duration((this.#iterations - iteration) / rate) : "–";
        element("memory").textContent = `${Math.round(bytes / 1e6)} MB`;
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

function duration(seconds) {
    const whole = Math.round(seconds);
    return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${whole % 60} s`;
}
