/**
 * How far away the scene is, from the cameras alone; the twin of `prior/scale.py`.
 *
 * @module
 */

import { centreOf } from "../capture/camera.js";
import { medianOf } from "../numbers/median.js";
import { focusPoint, looksAt, spreadOf } from "../seeding/focus.js";
import { length, subtract } from "../../page/scene/vectors.js";

/**
 * @typedef {Object} Scale of a scene
 * @property {number} distance typical distance from the cameras to the scene
 * @property {number} unit factor for thresholds given in metres: 1 if lengths are metres, otherwise the distance
 *
 * @param {import("../capture/camera.js").Camera[]} cameras
 * @param {boolean} isMetric whether lengths are metres
 * @param {Object} settings the settings' `volume` and `prior`
 * @returns {Scale}
 */
export function scaleOf(cameras, isMetric, settings) {
    const distance = typicalDistance(cameras, isMetric, settings);
    return { distance, unit: isMetric ? 1 : distance };
}

/**
 * The median distance from the cameras to the point nearest to their optical axes. If they face outwards or are in one
 * place: 2 m, or if lengths are not metres a multiple of the cameras' spread; 1 if that is zero.
 *
 * @param {import("../capture/camera.js").Camera[]} cameras
 * @param {boolean} isMetric whether lengths are metres
 * @param {Object} settings the settings' `volume` and `prior`
 * @returns {number}
 */
function typicalDistance(cameras, isMetric, { volume, prior: { scale } }) {
    const centres = cameras.map(centreOf);
    const focus = focusPoint(cameras, volume);
    const spread = spreadOf(centres);
    const farthest = Math.max(...centres.flat().map(Math.abs));
    const within = isMetric ? scale.one_place : Math.max(scale.rounding * farthest, scale.rounding ** 2);
    const inOnePlace = cameras.length > 1 && spread <= within;
    if (looksAt(cameras, focus) && !inOnePlace) {
        const distances = centres.map((centre) => length(subtract(centre, focus)));
        return Math.max(medianOf(distances), 1.1754944e-38);
    }
    if (isMetric) {
        return scale.metric_distance;
    }
    return inOnePlace ? 1 : Math.max(volume.guessed_distance * spread, 1.1754944e-38);
}
