/**
 * How far away the scene is, from the cameras, or from the capture's own points where those say nothing; the twin of
 * `prior/scale.py`.
 *
 * @module
 */

import { centreOf, forwardOf, projected } from "../capture/camera.js";
import { medianOf } from "../numbers/quantiles.js";
import { eigenvectors } from "../seeding/eigenvectors.js";
import { focusPoint, looksAt, spreadOf } from "../seeding/focus.js";
import { dot, length, subtract } from "../../page/scene/vectors.js";
import { ViewCells } from "./coverage.js";
import { seenPoints } from "./seen_points.js";

/**
 * @typedef {Object} Scale of a scene
 * @property {number} distance typical distance from the cameras to the scene
 * @property {number} unit factor for thresholds given in metres: 1 if lengths are metres, otherwise the distance
 *
 * @param {import("../capture/open.js").Capture} capture
 * @param {Object} settings the settings' `volume` and `prior`
 * @returns {Scale}
 */
export function scaleOf({ train, cloud, isMetric }, settings) {
    const cameras = train.map(({ camera }) => camera);
    const isKnown = isMetric || !cloud || axesMeet(cameras, settings);
    const depth = isKnown ? null : medianDepth(train, cloud, settings.prior);
    const distance = Math.max(depth ?? guess(cameras, isMetric, settings), 1.1754944e-38);
    return { distance, unit: isMetric ? 1 : distance };
}

/** Whether the optical axes determine a point that the cameras look at; lengths are not metres. */
function axesMeet(cameras, { volume }) {
    const forwards = cameras.map(forwardOf);
    const across = [0, 1, 2].map((i) =>
        [0, 1, 2].map((j) => forwards.reduce((sum, f) => sum + (i === j) - f[i] * f[j], 0) / forwards.length),
    );
    const [smallest, , largest] = eigenvectors(across).map((v) => dot(v, across.map((row) => dot(row, v))));
    const converge = smallest > volume.min_convergence * largest;
    return converge && looksAt(cameras, focusPoint(cameras, volume));
}

/** Of the capture's own points that the training photographs see; null if they see none. */
function medianDepth(train, cloud, settings) {
    const seen = seenPoints(cloud, new ViewCells(train, settings.coverage), settings);
    const depths = train.flatMap(({ camera }, view) => {
        const placeOf = (i) => projected(camera, ...seen[view].subarray(3 * i, 3 * i + 3));
        return Array.from({ length: seen[view].length / 3 }, (_, i) => placeOf(i)[2]);
    });
    return depths.length ? medianOf(depths) : null;
}

/**
 * The distance from the cameras alone: the median distance to the point nearest to their optical axes. If they face
 * outwards or are in one place: 2 m, or if lengths are not metres a multiple of the cameras' spread; 1 if that is zero.
 */
function guess(cameras, isMetric, { volume, prior: { scale } }) {
    const centres = cameras.map(centreOf);
    const focus = focusPoint(cameras, volume);
    const spread = spreadOf(centres);
    const inOnePlace = cameras.length > 1 && spread <= (isMetric ? scale.one_place : 0);
    if (looksAt(cameras, focus) && !inOnePlace) {
        return medianOf(centres.map((centre) => length(subtract(centre, focus))));
    }
    if (isMetric) {
        return scale.metric_distance;
    }
    return inOnePlace ? 1 : volume.guessed_distance * spread;
}
