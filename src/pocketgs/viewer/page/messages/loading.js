/**
 * Scenes on their way: the bar that shows how much of one has come, and which of several is to be shown.
 *
 * @module
 */

/**
 * @typedef {Object} Reading
 * @property {string} name
 * @property {number | null} share of the file that has come, null where nothing is known of it yet
 */

/** @type {Reading[]} in the order in which they began */
let underWay = [];
let begun = 0;
let shown = 0;

/**
 * Begin to open a scene, or a run with one scene after the other.
 *
 * @returns {() => boolean} to be asked before anything of it is shown: false once something begun later has been shown
 */
export function beginOpening() {
    const number = ++begun;
    return () => {
        const isNewest = number >= shown;
        shown = Math.max(shown, number);
        return isNewest;
    };
}

/**
 * Show the bar until a scene is there: that of the newest if there are several.
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
        // What began earlier will not be seen any more.
        underWay = underWay.slice(underWay.indexOf(reading) + 1);
        return scene;
    } finally {
        underWay = underWay.filter((other) => other !== reading);
        showNewest();
    }
}

function showNewest() {
    const newest = underWay.at(-1);
    document.getElementById("loading").hidden = !newest;
    if (newest) {
        const bar = document.getElementById("loaded");
        document.getElementById("loading-text").textContent = `Loading ${newest.name}`;
        if (newest.share === null) {
            bar.removeAttribute("value");
        } else {
            bar.value = newest.share;
        }
    }
}
