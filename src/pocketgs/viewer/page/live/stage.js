/**
 * What is done right now.
 *
 * @module
 */

import { element } from "../element.js";

/** How far a stage is, at its end. */
const COUNT = /,? [\d,]+ of [\d,]+$/;

/**
 * Show a stage. Screen readers tell of each new one, and not of how far it is.
 *
 * @param {string} text
 */
export function showStage(text) {
    element("stage").textContent = text;
    const announced = text.replace(COUNT, "");
    if (element("announced").textContent !== announced) {
        element("announced").textContent = announced;
    }
}
