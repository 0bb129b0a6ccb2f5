/**
 * Framing a scene without cameras.
 *
 * @module
 */

import { MEAN } from "../constants.js";

const SAMPLES = 4096;

/**
 * The middle of the scene and the radius of most of it, from a sample of its Gaussians.
 *
 * @param {import("./gaussian_columns.js").GaussianColumns} scene
 * @param {number} count number of its Gaussians that have arrived
 * @returns {{middle: [number, number, number], radius: number}}
 */
export function extentOf(scene, count) {
    const step = Math.max(1, Math.floor(count / SAMPLES));
    const quantiles = [0, 1, 2].map((axis) => {
        const means = scene.column(MEAN + axis);
        const every = Float32Array.from({ length: Math.ceil(count / step) }, (_, i) => means[i * step]);
        const sample = every.filter(Number.isFinite).sort();
        return [0.1, 0.5, 0.9].map((share) => sample[Math.floor(share * sample.length)] ?? 0);
    });
    const radius = Math.max(...quantiles.map(([low, , high]) => (high - low) / 2));
    return { middle: quantiles.map(([, median]) => median), radius: radius || 1 };
}
