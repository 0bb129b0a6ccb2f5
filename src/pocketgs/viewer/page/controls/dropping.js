/**
 * Dropping something on the page, which says so while it is dragged.
 *
 * @module
 */

import { element } from "../element.js";

/**
 * Listen for what is dropped.
 *
 * @param {(transfer: DataTransfer | null) => void} onDrop
 */
export function listenForDrops(onDrop) {
    const hint = element("drop");
    window.addEventListener("dragover", (event) => {
        event.preventDefault();
        hint.hidden = false;
    });
    window.addEventListener("dragleave", (event) => {
        // The pointer has left the page.
        hint.hidden = event.relatedTarget === null;
    });
    window.addEventListener("drop", (event) => {
        event.preventDefault();
        hint.hidden = true;
        onDrop(event.dataTransfer);
    });
}
