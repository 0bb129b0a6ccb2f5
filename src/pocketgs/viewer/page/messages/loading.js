/**
 * The progress bar of loading scenes.
 *
 * @module
 */

import { element } from "../element.js";

/**
 * @typedef {Object} Reading
 * @property {string} name
 * @property {number | null} share of the file that has arrived, null if unknown
 */

/** @type {Reading[]} in order of their start */
let underWay = [];

/**
 * Show the bar until a scene is loaded; of several, that of the newest.
 *
 * @template T
 * @param {string} name
 * @param {(onProgress: (share: number) => void) => Promise<T>} read
 * @returns {Promise<T>}
 */
export async function whileLoading(name, read) {
    const reading = { name, share: null };
    underWay.push(reading);
    showNewest();
    try {
        const scene = await read((share) => {
            reading.share = share;
            showNewest();
        });
        // What started earlier will not be shown any more.
        underWay = underWay.slice(underWay.indexOf(reading) + 1);
        return scene;
    } finally {
        underWay = underWay.filter((other) => other !== reading);
        showNewest();
    }
}

function showNewest() {
    const newest = underWay.at(-1);
    element("loading").hidden = !newest;
    if (newest) {
        const bar = element("loaded");
        element("loading-text").textContent = `Loading ${newest.name}`;
        if (newest.share === null) {
            bar.removeAttribute("value");
        } else {
            bar.value = newest.share;
        }
    }
}
