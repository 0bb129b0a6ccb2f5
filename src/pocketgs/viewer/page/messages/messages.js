/**
 * What goes wrong, in words; and pictures of the scene where there is no WebGPU.
 *
 * @module
 */

const POINTS_ONLY = "Here the scene is shown as points. This page renders it with WebGPU, which is not to be had here.";

const BROWSERS = `Browsers that have WebGPU: Chrome and Edge from version 113 on (on Android from 121), Safari from 26,
Firefox from 141 on Windows and from 145 on Macs with Apple silicon.`.replaceAll("\n", " ");

const INSECURE = "Browsers offer WebGPU to pages from https or from this very machine only.";

/** @type {Error | null} why there is no GPU, once that has been said */
let whyNoGpu = null;

/**
 * Show a message until it is closed.
 *
 * @param {string} text
 */
export function showMessage(text) {
    document.getElementById("message-text").textContent = text;
    document.getElementById("previews").hidden = true;
    document.getElementById("message").hidden = false;
    document.getElementById("message-close").onclick = hideMessage;
}

/** Close the message, if there is one. */
export function hideMessage() {
    document.getElementById("message").hidden = true;
}

/**
 * Say that this browser shows no more than points, and show below what was rendered before.
 *
 * @param {Error} error from opening the GPU
 * @param {{previews: string[]}} viewer from viewer.json
 */
export function showWithoutGpu(error, { previews }) {
    whyNoGpu = error;
    showMessage([POINTS_ONLY, reasonFor(error), BROWSERS].join("\n\n"));
    const gallery = document.getElementById("previews");
    gallery.replaceChildren(...previews.map(pictureOf));
    gallery.hidden = previews.length === 0;
}

/**
 * Where there is no GPU, say so again, with pictures that there have not been before.
 *
 * @param {string[]} previews their addresses
 */
export function showPreviews(previews) {
    if (whyNoGpu && previews.length > 0) {
        showWithoutGpu(whyNoGpu, { previews });
    }
}

function pictureOf(url) {
    const picture = new Image();
    picture.src = url;
    picture.alt = `photograph and rendering: ${url.split("/").at(-1)}`;
    picture.loading = "lazy";
    return picture;
}

function reasonFor(error) {
    return window.isSecureContext ? `The browser says: ${error.message}.` : INSECURE;
}
