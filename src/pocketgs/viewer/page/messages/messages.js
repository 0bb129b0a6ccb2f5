/**
 * Error messages, and images of the scene for browsers without WebGPU.
 *
 * @module
 */

import { element } from "../element.js";

const POINTS_ONLY = "The scene is shown as points: this page renders splats with WebGPU, which is not available here.";

const BROWSERS = `Browsers that have WebGPU: Chrome and Edge from version 113 on (on Android from 121), Safari from 26,
Firefox from 141 on Windows and from 145 on Macs with Apple silicon.`.replaceAll("\n", " ");

const INSECURE = "Browsers allow WebGPU only on pages from https or from the local machine.";

/** @type {Error | null} why there is no GPU, once that has been shown */
let whyNoGpu = null;

/**
 * Show a message until it is closed.
 *
 * @param {string} text
 */
export function showMessage(text) {
    element("message-text").textContent = text;
    element("previews").hidden = true;
    element("message").hidden = false;
    element("message-close").onclick = hideMessage;
}

/** Close the message, if there is one. */
export function hideMessage() {
    element("message").hidden = true;
}

/**
 * Say that this browser shows points only, and show rendered images below.
 *
 * @param {Error} error from opening the GPU
 * @param {{previews: string[]}} viewer from viewer.json
 */
export function showWithoutGpu(error, { previews }) {
    whyNoGpu = error;
    showMessage([POINTS_ONLY, reasonFor(error), BROWSERS].join("\n\n"));
    const gallery = element("previews");
    gallery.replaceChildren(...previews.map(pictureOf));
    gallery.hidden = previews.length === 0;
}

/**
 * Without a GPU, show the message again when there are new images.
 *
 * @param {string[]} previews their URLs
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
