/**
 * What the page says about a capture.
 *
 * @module
 */

import { sizeOf } from "../page/size_text.js";

export const EFFORTS = { quick: "Quick", standard: "Standard", best: "Best" };

/**
 * @param {Object} capture what the server tells about it
 * @param {boolean} isHere whether this page uploads it
 */
export function stateOf(capture, isHere) {
    switch (capture.state) {
        case "uploading":
            return uploadingText(capture, isHere);
        case "checking":
            return "checking what has arrived";
        case "queued":
            return capture.place === 1 ? "next to be trained" : `waiting, number ${capture.place} in the queue`;
        case "training":
            return trainingText(capture.progress);
        case "unusable":
            return "cannot be used";
        case "failed":
            return "training failed";
        case "stopped":
            return capture.result ? resultText(capture.result) : "not trained";
        default:
            return capture.result ? resultText(capture.result) : "";
    }
}

/** How far it is, from 0 to 1; null if that is unknown, undefined if nothing goes on. */
export function shareOf({ state, received, bytes, progress }) {
    if (state === "uploading") {
        return received / bytes;
    }
    if (state === "training") {
        return progress?.iteration ? progress.iteration / progress.iterations : null;
    }
    return state === "checking" ? null : undefined;
}

function uploadingText({ received, bytes, active }, isHere) {
    const share = `${Math.floor((100 * received) / bytes)}\u00a0% of ${sizeOf(bytes)}`;
    if (isHere) {
        return `uploading: ${share}`;
    }
    return active ? `uploading on another page: ${share}` : `upload interrupted at ${share}`;
}

function trainingText(progress) {
    if (!progress?.iteration || progress.finished) {
        return progress?.stage ?? "starting";
    }
    if (progress.paused) {
        return `paused at ${progress.iteration} of ${progress.iterations}: open Watch to resume`;
    }
    const left = progress.seconds_left;
    const duration = left < 90 ? `${Math.ceil(left)}\u00a0s` : `${Math.round(left / 60)}\u00a0min`;
    const time = left > 0 ? `, ${duration} left` : "";
    return `${progress.stage}: ${progress.iteration} of ${progress.iterations}${time}`;
}

function resultText({ psnr, gaussians, bytes, interrupted, iterations }) {
    const parts = [
        psnr === null ? null : `${psnr.toFixed(1)}\u00a0dB`,
        `${gaussians.toLocaleString("en")} splats`,
        sizeOf(bytes),
        interrupted ? `stopped after ${iterations}` : null,
    ];
    return parts.filter(Boolean).join(" · ");
}
