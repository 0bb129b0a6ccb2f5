/**
 * Photometric agreement: how alike two photographs are around a point, under given poses; the twin of
 * `prior/poses/photometric.py`.
 *
 * @module
 */

import { centreOf, projected, rayOf } from "../../capture/camera.js";
import { indicesWhere, startsOf } from "../features/observations.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 * @typedef {import("../../capture/photograph.js").Frame} Frame
 */

/**
 * Normalised cross-correlation of each observation's patch with that of the next observation of its track. The patch is
 * a plane through the point, parallel to the image of the first view.
 *
 * @param {Camera[]} cameras
 * @param {Frame[]} frames of the cameras
 * @param {Observations} tracks M observations, sorted by point
 * @param {Float64Array} points (M, 3) the point that the track's other observations tell; NaN if unknown
 * @param {{radius: number, step: number, min_contrast: number, most: number}} settings of `poses.photometric`
 * @returns {Float64Array} (M,) in [-1, 1]; NaN where unknown
 */
export function correlations(cameras, frames, tracks, points, settings) {
    const found = new Float64Array(tracks.frame.length).fill(NaN);
    const every = Math.max(1, Math.ceil(found.length / settings.most)); // the same under any poses
    const next = nextOfTrack(tracks);
    for (const i of indicesWhere(found.length, (i) => i % every === 0 && Number.isFinite(points[3 * i]))) {
        const [view, source] = [tracks.frame[i], tracks.frame[next[i]]];
        const { places, surface } = patchOf(cameras[view], points.subarray(3 * i, 3 * i + 3), settings);
        const warped = surface.map((position) => projected(cameras[source], ...position));
        const [seen, there] = [sampled(frames[view], places), sampled(frames[source], warped)];
        found[i] = seen && there ? correlation(seen, there, settings.min_contrast) : NaN;
    }
    return found;
}

/** For each observation the next one of its track; the first follows the last. */
function nextOfTrack(tracks) {
    const next = Int32Array.from(tracks.frame, (_, i) => i + 1);
    const starts = startsOf(tracks);
    for (let track = 0; track + 1 < starts.length; track++) {
        next[starts[track + 1] - 1] = starts[track];
    }
    return next;
}

/** Columns, rows and depths of the samples around a point, and their positions in the world. */
function patchOf(camera, point, { radius, step }) {
    const [centre, [column, row, depth]] = [centreOf(camera), projected(camera, ...point)];
    const offsets = Array.from({ length: 2 * radius + 1 }, (_, k) => (k - radius) * step);
    const places = offsets.flatMap((down) => offsets.map((right) => [column + right, row + down, depth]));
    const surface = places.map(([x, y]) => rayOf(camera, x, y).map((value, axis) => centre[axis] + depth * value));
    return { places, surface };
}

/** Brightness at places of a photograph; null if one of them is outside. */
function sampled({ rgba, camera: { width, height } }, places) {
    const isInside = ([x, y, depth]) => depth > 0 && x >= 0 && x < width && y >= 0 && y < height;
    if (!places.every(isInside)) {
        return null;
    }
    const greyAt = (column, row) => {
        const [x, y] = [Math.min(Math.max(column, 0), width - 1), Math.min(Math.max(row, 0), height - 1)];
        const at = 4 * (y * width + x);
        return Math.round(0.299 * rgba[at] + 0.587 * rgba[at + 1] + 0.114 * rgba[at + 2]);
    };
    return places.map(([x, y]) => {
        const [left, top] = [Math.floor(x - 0.5), Math.floor(y - 0.5)];
        const [right, down] = [x - 0.5 - left, y - 0.5 - top];
        const upper = (1 - right) * greyAt(left, top) + right * greyAt(left + 1, top);
        return (1 - down) * upper + down * ((1 - right) * greyAt(left, top + 1) + right * greyAt(left + 1, top + 1));
    });
}

function correlation(first, second, minContrast) {
    const [one, other] = [first, second].map((values) => {
        const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
        return values.map((value) => value - mean);
    });
    const product = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0) / a.length;
    const contrasts = [one, other].map((values) => Math.sqrt(product(values, values)));
    return Math.min(...contrasts) > minContrast ? product(one, other) / (contrasts[0] * contrasts[1]) : NaN;
}
