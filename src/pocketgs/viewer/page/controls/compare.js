/**
 * A held-out photograph over its rendering, and a slider between them.
 *
 * @module
 */

import { element } from "../element.js";

/** @typedef {import("../scene/camera.js").MovingCamera} MovingCamera */

/** Covers the part of the canvas that the photograph shows. */
export class Comparison {
    #camera;
    #frame = element("compare");
    #photo = element("photo");
    #button = element("compare-button");

    /** @param {MovingCamera} camera */
    constructor(camera) {
        this.#camera = camera;
        const slider = element("share");
        slider.addEventListener("input", () => this.#frame.style.setProperty("--share", `${slider.value}%`));
        window.addEventListener("resize", () => this.#place());
    }

    /** Whether it is on. */
    get isOn() {
        return !this.#frame.hidden;
    }

    /**
     * Show a photograph over the canvas, whose camera must be the photograph's.
     *
     * @param {{name: string, photo: string}} view
     */
    show({ name, photo }) {
        this.#photo.src = photo;
        this.#photo.alt = `photograph ${name}`;
        this.#camera.showsAll = true;
        this.#frame.hidden = false;
        this.#button.setAttribute("aria-pressed", "true");
        this.#place();
    }

    /** Hide the photograph. */
    hide() {
        this.#camera.showsAll = false;
        this.#frame.hidden = true;
        this.#button.setAttribute("aria-pressed", "false");
    }

    #place() {
        const { left, top, width, height } = this.#camera.frameIn(window.innerWidth, window.innerHeight);
        Object.assign(this.#frame.style, {
            left: `${left}px`,
            top: `${top}px`,
            width: `${width}px`,
            height: `${height}px`,
        });
    }
}
