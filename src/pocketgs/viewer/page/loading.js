/**
 * The bar that shows how much of a scene has come.
 *
 * @module
 */

/**
 * Show the bar until a scene is there.
 *
 * @template T
 * @param {string} name
 * @param {(onProgress: (share: number) => void) => Promise<T>} read
 * @returns {Promise<T>}
 */
export async function whileLoading(name, read) {
    const [card, bar] = [document.getElementById("loading"), document.getElementById("loaded")];
    document.getElementById("loading-text").textContent = `Loading ${name}`;
    bar.removeAttribute("value");
    card.hidden = false;
    try {
        return await read((share) => (bar.value = share));
    } finally {
        card.hidden = true;
    }
}
