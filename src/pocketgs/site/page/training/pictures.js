/**
 * Pictures of a scene while it trains. Where the GPU has no room for one, training goes on without.
 *
 * @module
 */

import { resized } from "../capture/camera.js";
import { halved } from "./buffer_sizes.js";
import { onScreen, psnr } from "./evaluation.js";
import { PictureError } from "./trainer.js";

/**
 * @typedef {import("../capture/camera.js").Camera} Camera
 *
 * @typedef {Object} Picture
 * @property {number} width
 * @property {number} height
 * @property {Uint8ClampedArray} rgba
 */

/** Draws the scene of a trainer. */
export class Pictures {
    #trainer;
    #onComplaint;
    #hasComplained = false;

    /**
     * @param {import("./trainer.js").Trainer} trainer
     * @param {(text: string) => void} onComplaint called once at most: pictures are asked for every second
     */
    constructor(trainer, onComplaint) {
        this.#trainer = trainer;
        this.#onComplaint = onComplaint;
    }

    /**
     * A picture for the screen, of half the size where there is no room for a whole one.
     *
     * @param {Camera} camera
     * @returns {Promise<Picture | null>} null where there is no room for that either
     */
    async of(camera) {
        const { width, height } = halved(camera);
        const half = resized(camera, width, height);
        return (await this.#drawn(camera)) ?? (await this.#drawn(half, "The scene cannot be drawn"));
    }

    /**
     * Mean PSNR of what is rendered for photographs.
     *
     * @param {import("../capture/photograph.js").Frame[]} frames
     * @returns {Promise<number | null>} null where there is no room for all of them, or there are none
     */
    async psnrOf(frames) {
        let sum = 0;
        for (const { camera, rgba, mask } of frames) {
            const rendered = await this.#rendered(camera, "The held-out photographs cannot be drawn");
            sum += rendered ? psnr(rendered, rgba, mask) : NaN;
        }
        const mean = sum / frames.length;
        return Number.isNaN(mean) ? null : mean;
    }

    async #drawn(camera, complaint = "") {
        const rendered = await this.#rendered(camera, complaint);
        return rendered && { width: camera.width, height: camera.height, rgba: onScreen(rendered) };
    }

    async #rendered(camera, complaint) {
        try {
            return await this.#trainer.render(camera);
        } catch (error) {
            if (!(error instanceof PictureError)) {
                throw error;
            }
            this.#complainOnce(complaint, error);
            return null;
        }
    }

    #complainOnce(complaint, { message }) {
        if (complaint && !this.#hasComplained) {
            this.#hasComplained = true;
            this.#onComplaint(`${complaint}: ${message}`);
        }
    }
}
