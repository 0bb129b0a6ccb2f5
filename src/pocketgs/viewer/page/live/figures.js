/**
 * The figures of a run.
 *
 * @module
 */

import { element } from "../element.js";

/**
 * Show how far a run is, and what became of it.
 *
 * @param {Object} progress
 * @param {number} progress.iteration
 * @param {number | null} progress.iterations of the whole run, 0 or null if unknown
 * @param {number | null} progress.loss
 * @param {number | null} progress.held_out_psnr dB
 * @param {number | null} progress.seconds_left
 * @param {number} progress.memory_mb
 */
export function showFigures({ iteration, iterations, loss, held_out_psnr, seconds_left, memory_mb }) {
    const show = (id, text) => (element(id).textContent = text);
    element("training").value = iterations ? iteration / iterations : 0;
    show("iteration", iterations ? `${iteration} / ${iterations}` : "");
    show("loss", loss?.toPrecision(3) ?? "–");
    show("psnr", held_out_psnr ? `${held_out_psnr.toFixed(2)} dB` : "–");
    show("left", duration(seconds_left));
    show("memory", `${Math.round(memory_mb)} MB`);
}

function duration(seconds) {
    if (seconds === null || seconds === undefined) {
        return "–";
    }
    const whole = Math.round(seconds);
    return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${whole % 60} s`;
}
