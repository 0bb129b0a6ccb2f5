/**
 * Gaussians as points: position, colour and size of each.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, SH_DC } from "../scene/gaussian_columns.js";
import { nearPlane } from "../scene/near_plane.js";

/** @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns */

/** A point covers the area where its Gaussian alone is at least this opaque; its size is 0 if there is none. */
const MIN_OPACITY = 0.1;

/** Points of a scene that may still be loading. */
export class Points {
    #scene;

    /** @param {GaussianColumns} scene */
    constructor(scene) {
        this.#scene = scene;
        this.count = 0;
        /** Minimum depth of what is drawn. */
        this.near = 0;
        /** (N,) each, in the world. */
        [this.x, this.y, this.z] = [0, 1, 2].map((axis) => scene.column(MEAN + axis));
        /** (N,) radii in scene units, 0 if invisible. */
        this.radii = new Float32Array(scene.count);
        /** (N,) RGBA, lowest byte first. */
        this.colours = new Uint32Array(scene.count);
    }

    /**
     * Whether these are points of this scene.
     *
     * @param {GaussianColumns} scene
     */
    areOf(scene) {
        return scene === this.#scene;
    }

    /**
     * Add the Gaussians that have arrived since the last call.
     *
     * @param {number} count number of the scene's Gaussians that have arrived
     */
    extendTo(count) {
        const [a, b, c] = [0, 1, 2].map((axis) => this.#scene.column(LOG_SCALE + axis));
        const [red, green, blue] = [0, 1, 2].map((channel) => this.#scene.harmonics(0, channel));
        const logits = this.#scene.column(OPACITY_LOGIT);
        for (let i = this.count; i < count; i++) {
            const opacity = 1 / (1 + Math.exp(-logits[i]));
            if (opacity > MIN_OPACITY) {
                // A ball of the same volume, up to where exp(-½ r²) · opacity falls to the minimum.
                const scale = Math.exp((a[i] + b[i] + c[i]) / 3);
                this.radii[i] = scale * Math.sqrt(2 * Math.log(opacity / MIN_OPACITY));
                this.colours[i] = 0xff000000 | (byteOf(blue[i]) << 16) | (byteOf(green[i]) << 8) | byteOf(red[i]);
            }
        }
        this.count = count;
        this.near = nearPlane([this.x, this.y, this.z], count);
    }
}

/** The view-independent colour. */
function byteOf(dc) {
    return Math.max(0, Math.min(255, Math.round(255 * (0.5 + SH_DC * dc))));
}
