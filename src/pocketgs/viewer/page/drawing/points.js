/**
 * What is drawn of Gaussians where they are no more than points: for each a place, a colour and a size.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, SH_DC } from "../scene/gaussian_columns.js";
import { nearPlane } from "../scene/near_plane.js";

/** @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns */

/** A point covers what its Gaussian alone makes at least this opaque; one that is so nowhere has no size. */
const MIN_OPACITY = 0.1;

/** Points of a scene that may still be arriving. */
export class Points {
    #scene;

    /** @param {GaussianColumns} scene */
    constructor(scene) {
        this.#scene = scene;
        this.count = 0;
        /** Least depth of what is drawn. */
        this.near = 0;
        /** (N,) each in the world. */
        [this.x, this.y, this.z] = [0, 1, 2].map((axis) => scene.column(MEAN + axis));
        /** (N,) in scene units, 0 where nothing is to be seen. */
        this.radii = new Float32Array(scene.count);
        /** (N,) RGBA from the lowest byte on. */
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
     * Take in what has arrived of the scene since.
     *
     * @param {number} count of the scene's Gaussians that are there, from the first on
     */
    extendTo(count) {
        const [a, b, c] = [0, 1, 2].map((axis) => this.#scene.column(LOG_SCALE + axis));
        const [red, green, blue] = [0, 1, 2].map((channel) => this.#scene.harmonics(0, channel));
        const logits = this.#scene.column(OPACITY_LOGIT);
        for (let i = this.count; i < count; i++) {
            const opacity = 1 / (1 + Math.exp(-logits[i]));
            if (opacity > MIN_OPACITY) {
                // A ball of the same volume, out to where exp(-½ r²) · opacity has come down to the least.
                const scale = Math.exp((a[i] + b[i] + c[i]) / 3);
                this.radii[i] = scale * Math.sqrt(2 * Math.log(opacity / MIN_OPACITY));
                this.colours[i] = 0xff000000 | (byteOf(blue[i]) << 16) | (byteOf(green[i]) << 8) | byteOf(red[i]);
            }
        }
        this.count = count;
        this.near = nearPlane([this.x, this.y, this.z], count);
    }
}

/** A colour without its dependence on the direction. */
function byteOf(dc) {
    return Math.max(0, Math.min(255, Math.round(255 * (0.5 + SH_DC * dc))));
}
