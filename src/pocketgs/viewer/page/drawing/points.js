/**
 * Gaussians as points: position, shape, opacity and view-independent colour of each.
 *
 * @module
 */

import { ALPHA_MIN, LOG_SCALE, MAX_LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION, SH_DC } from "../constants.js";
import { nearPlane } from "../scene/near_plane.js";
import { axesOf } from "../scene/vectors.js";

/** @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns */

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
        /** (N, 6) covariances in the world: xx, xy, xz, yy, yz, zz. */
        this.covariances = new Float32Array(6 * scene.count);
        /** (N,) 0 if invisible. */
        this.opacities = new Float32Array(scene.count);
        /** (N,) RGB in [0, 255], lowest byte first. */
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
        const [red, green, blue] = [0, 1, 2].map((channel) => this.#scene.harmonics(0, channel));
        const logits = this.#scene.column(OPACITY_LOGIT);
        for (let i = this.count; i < count; i++) {
            const opacity = 1 / (1 + Math.exp(-logits[i]));
            if (opacity >= ALPHA_MIN && this.#setCovariance(i)) {
                this.opacities[i] = opacity;
                this.colours[i] = (byteOf(blue[i]) << 16) | (byteOf(green[i]) << 8) | byteOf(red[i]);
            }
        }
        this.count = count;
        this.near = nearPlane([this.x, this.y, this.z], count);
    }

    /** Σ = R S Sᵀ Rᵀ (3DGS, equation 6). Returns whether the numbers that it follows from are sound. */
    #setCovariance(i) {
        const { shape, count } = this.#scene;
        const at = (column) => shape[column * count + i];
        const logScales = [at(LOG_SCALE), at(LOG_SCALE + 1), at(LOG_SCALE + 2)];
        const quaternion = [at(QUATERNION), at(QUATERNION + 1), at(QUATERNION + 2), at(QUATERNION + 3)];
        const length = Math.hypot(...quaternion);
        if (!(Number.isFinite(length) && logScales.every((scale) => Number.isFinite(scale) && scale < MAX_LOG_SCALE))) {
            return false;
        }
        // What a file holds may not be of unit length before it is read to its end.
        const [p, q, r] = axesOf(length > 0 ? quaternion.map((part) => part / length) : [1, 0, 0, 0]);
        const [a, b, c] = logScales.map((scale) => Math.exp(2 * scale));
        const entry = (row, column) => a * p[row] * p[column] + b * q[row] * q[column] + c * r[row] * r[column];
        const entries = [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)];
        this.covariances.set(entries, 6 * i);
        return true;
    }
}

/** The view-independent colour. */
function byteOf(dc) {
    return Math.max(0, Math.min(255, Math.round(255 * (0.5 + SH_DC * dc))));
}
