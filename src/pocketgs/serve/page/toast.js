/**
 * A line at the bottom of the page: what went wrong, or what was done, with a way back.
 *
 * @module
 */

import { element } from "../page/element.js";

const SECONDS = 10;
const toast = element("toast");
const undo = element("undo");
let timer = 0;

/** @type {(text: string, onUndo?: () => void) => void} */
export function showToast(text, onUndo) {
    toast.firstElementChild.textContent = text;
    undo.textContent = onUndo ? "Undo" : "Close";
    undo.onclick = () => {
        hideToast();
        onUndo?.();
    };
    toast.hidden = false;
    clearTimeout(timer);
    timer = setTimeout(hideToast, 1000 * SECONDS);
}

export function hideToast() {
    toast.hidden = true;
}
