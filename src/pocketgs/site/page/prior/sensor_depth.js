/**
 * Filling depth maps with the depth of a phone's sensor where matching is unsure; the twin of
 * `prior/depth/sensor_depth.py`.
 *
 * @module
 */

import { medianOf } from "../numbers/quantiles.js";
import { isUsable } from "./photographs.js";

/**
 * The depth map with measured depths where matching is unsure, scaled to the confident matched ones.
 *
 * @param {import("./stereo.js").DepthMap} map from matching
 * @param {import("../capture/photograph.js").Frame} frame of the same size
 * @param {Object<string, number>} settings the settings' `prior.sensor_depth`
 * @returns {import("./stereo.js").DepthMap}
 */
export function completed(map, frame, settings) {
    if (!frame.depth) {
        return map;
    }
    const [weak, sure] = [settings.weak_margin, settings.sure_margin].map(Math.fround);
    const measured = frame.depth.map((depth, i) => (isUsable(frame, i) ? depth : 0));
    const { margin, step } = map;
    const isSure = (i) => map.depth[i] > 0 && measured[i] > 0 && margin[i] >= sure;
    const ratios = map.depth.map((depth, i) => depth / measured[i]).filter((_, i) => isSure(i));
    const scale = Math.fround(ratios.length >= settings.min_pixels ? medianOf(ratios) : 1);
    const isUnsure = (i) => measured[i] > 0 && (map.depth[i] === 0 || margin[i] < weak);
    return {
        depth: map.depth.map((depth, i) => (isUnsure(i) ? measured[i] * scale : depth)),
        margin: margin.map((value, i) => (isUnsure(i) ? sure : value)),
        step,
    };
}
