/**
 * Which frames a keyframe is compared with, and where its pixels fall in them;
 * the twin of `prior/depth/source_views.py`.
 *
 * @module
 */

import { centreOf, isInImage, projected } from "../capture/camera.js";
import { dot, length, subtract } from "../../page/scene/vectors.js";

/** @typedef {import("../capture/camera.js").Camera} Camera */

/**
 * Choose source views such that two of them see most of what the keyframe sees, from a good angle.
 *
 * @param {number} keyframe its index
 * @param {Camera[]} cameras of all frames
 * @param {Float64Array} points (N, 3) that it sees
 * @param {Object} settings the settings' `sweep`
 * @returns {number[]} indices of frames
 */
export function chooseSourceViews(keyframe, cameras, points, settings) {
    const others = cameras.map((_, index) => index).filter((index) => index !== keyframe);
    const scores = others.map((index) => scoresOf(cameras[keyframe], cameras[index], points, settings));
    const count = points.length / 3;
    const [best, second] = [new Float64Array(count), new Float64Array(count)];
    const chosen = [];
    while (chosen.length < Math.min(settings.source_views, others.length)) {
        const added = scores.map((score, i) => {
            const gain = (sum, value, j) => sum + Math.max(value, second[j]) - second[j] + settings.third_view * value;
            return chosen.includes(i) ? -count : score.reduce(gain, 0);
        });
        const index = added.indexOf(Math.max(...added));
        if (!scores[index].some((score) => score > 0)) {
            break;
        }
        chosen.push(index);
        scores[index].forEach((score, j) => {
            second[j] = Math.max(second[j], Math.min(best[j], score));
            best[j] = Math.max(best[j], score);
        });
    }
    return chosen.map((index) => others[index]);
}

/** Of another camera, for the depths of points: exp(-(b - b_target)² / 2 σ²) · min(α / α_min, 1) where it sees them. */
function scoresOf(view, other, points, settings) {
    const { angle: target, least_angle: least, least_parallax: fewest, baseline_spread: spread } = settings;
    const [own, theirs] = [centreOf(view), centreOf(other)];
    const baseline = length(subtract(own, theirs));
    return Float64Array.from({ length: points.length / 3 }, (_, i) => {
        const point = points.subarray(3 * i, 3 * i + 3);
        if (!isInImage(other, projected(other, ...point))) {
            return 0;
        }
        const [here, there] = [subtract(own, point), subtract(theirs, point)];
        const cosine = dot(here, there) / Math.max(length(here) * length(there), 1e-30);
        const angle = Math.acos(Math.min(Math.max(cosine, -1), 1));
        if (angle < fewest) {
            return 0;
        }
        const misfit = baseline / (Math.tan(target) * length(here)) - 1;
        return Math.exp(-(misfit ** 2) / (2 * spread ** 2)) * Math.min(angle / least, 1);
    });
}

/**
 * Where the pixels of a view fall in another: a pixel (x, y, 1) at inverse depth i at (u/w, v/w) with (u, v, w) =
 * turn · (x, y, 1) + i · shift.
 *
 * @param {Camera} view
 * @param {Camera} other
 * @returns {{turn: number[][], shift: number[]}}
 */
export function mappingTo(view, other) {
    const { rotation, translation } = relativePose(view, other);
    const seen = ([x, y, z]) => [other.fx * x + other.cx * z, other.fy * y + other.cy * z, z];
    const columns = [
        [1 / view.fx, 0, 0],
        [0, 1 / view.fy, 0],
        [-view.cx / view.fx, -view.cy / view.fy, 1],
    ].map((column) => seen(rotation.map((row) => dot(row, column))));
    return { turn: [0, 1, 2].map((row) => columns.map((column) => column[row])), shift: seen(translation) };
}

/**
 * From the axes of one camera to those of another.
 *
 * @param {Camera} view
 * @param {Camera} other
 * @returns {{rotation: number[][], translation: number[]}} rows
 */
export function relativePose({ world_to_camera: from }, { world_to_camera: to }) {
    const rowsOf = (m) => [0, 4, 8].map((first) => m.slice(first, first + 3));
    const rotation = rowsOf(to).map((row) => rowsOf(from).map((other) => dot(row, other)));
    const start = [from[3], from[7], from[11]];
    return { rotation, translation: rotation.map((row, i) => to[4 * i + 3] - dot(row, start)) };
}
