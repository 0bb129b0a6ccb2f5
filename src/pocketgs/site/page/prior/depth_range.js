/**
 * The depths that a sweep tests, evenly spaced in inverse depth; the twin of `prior/depth/depth_range.py`.
 *
 * @module
 */

import { centreOf } from "../capture/camera.js";
import { evenly } from "../numbers/evenly.js";
import { quantileOf } from "../numbers/quantiles.js";
import { length, subtract } from "../../page/scene/vectors.js";

/**
 * @typedef {import("../capture/camera.js").Camera} Camera
 *
 * @typedef {Object} DepthRange
 * @property {number} nearest
 * @property {number} farthest infinite if objects are so far away that they hardly shift
 * @property {number} hypotheses number of depths
 */

/** Ascending. Infinite depth counts as half a step from infinity. @type {(range: DepthRange) => Float32Array} */
export function inverseDepths({ nearest, farthest, hypotheses }) {
    if (farthest < Infinity) {
        return Float32Array.from(evenly(1 / farthest, 1 / nearest, hypotheses));
    }
    return Float32Array.from({ length: hypotheses }, (_, i) => (i + 0.5) / (hypotheses - 0.5) / nearest);
}

/** Difference of neighbouring hypotheses. @type {(inverse: Float32Array) => number} */
export const stepOf = (inverse) => Math.fround(inverse[1] - inverse[0]);

/**
 * All plausible depths: from well in front of the nearest points to infinity.
 *
 * @param {Float64Array} depths of the points that the keyframe sees
 * @param {number} distance typical distance to the scene, for too few points
 * @param {Object} settings the settings' `depth_range`
 * @returns {DepthRange}
 */
export function wideRange(depths, distance, settings) {
    const wide = { farthest: Infinity, hypotheses: settings.wide_hypotheses };
    if (depths.length < settings.min_points) {
        return { nearest: settings.unknown_nearest * distance, ...wide };
    }
    const near = settings.nearest_share * quantileOf(Float64Array.from(depths).sort(), settings.nearest_quantile);
    const octaves = Math.floor(settings.nearest_an_octave * Math.log2(near)) / settings.nearest_an_octave;
    return { nearest: 2 ** octaves, ...wide };
}

/**
 * The range of the depths found, with hypotheses as fine as the source views can resolve.
 *
 * @param {DepthRange} wide the range of the first sweep
 * @param {Float64Array} found confident depths of the first sweep, and those of points
 * @param {Camera} view
 * @param {Camera[]} sources
 * @param {Object} settings the settings' `depth_range`
 * @returns {DepthRange}
 */
export function narrowed(wide, found, view, sources, settings) {
    const inverse = inverseDepths(wide);
    const step = stepOf(inverse);
    let [low, high] = [inverse[0], inverse.at(-1)];
    if (found.length >= settings.min_points) {
        const sorted = found.map((depth) => 1 / depth).sort();
        const [far, near] = settings.quantiles.map((share) => quantileOf(sorted, share));
        const unit = step / settings.limits_per_step;
        low = Math.max(low, unit * Math.floor((far - settings.widened * step) / unit));
        high = Math.min(high, unit * Math.ceil((near + settings.widened * step) / unit));
    }
    const isUnbounded = low <= step;
    const centre = centreOf(view);
    const baseline = Math.max(0, ...sources.map((other) => length(subtract(centreOf(other), centre))));
    const shift = (high - (isUnbounded ? 0 : low)) * baseline * Math.max(view.fx, view.fy);
    const steps = Math.ceil(shift / settings.pixels_per_step);
    return {
        nearest: 1 / high,
        farthest: isUnbounded ? Infinity : 1 / low,
        hypotheses: Math.min(Math.max(steps, settings.fewest), settings.most),
    };
}

/**
 * Depths along the optical axis of the points in front of a camera.
 *
 * @param {Camera} camera
 * @param {Float64Array} points (N, 3)
 * @returns {Float64Array}
 */
export function depthsOf({ world_to_camera: m }, points) {
    const depths = Float64Array.from({ length: points.length / 3 }, (_, i) => {
        return m[8] * points[3 * i] + m[9] * points[3 * i + 1] + m[10] * points[3 * i + 2] + m[11];
    });
    return depths.filter((depth) => depth > 0);
}
