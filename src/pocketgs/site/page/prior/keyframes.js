/**
 * Which frames' depth is computed; the twin of `prior/keyframes.py`: the next keyframe is the frame that sees most of
 * what too few keyframes see so far.
 *
 * @module
 */

import { centreOf, isInImage, projected, rayOf } from "../capture/camera.js";
import { sharpness } from "../capture/sharpness.js";
import { evenly } from "../numbers/evenly.js";
import { medianOf } from "../numbers/quantiles.js";
import { roundedToEven } from "../numbers/rounding.js";
import { add, length, subtract } from "../../page/scene/vectors.js";
import { inCells, isUsable } from "./photographs.js";

/**
 * @typedef {import("../capture/photograph.js").Frame} Frame
 *
 * @typedef {Object} Cells of one view
 * @property {import("../capture/camera.js").Camera} camera
 * @property {[number, number, number]} centre
 * @property {number} rows
 * @property {number} columns
 * @property {Float64Array} depths of all cells
 * @property {{position: number[], footprint: number}[]} middles of the usable cells
 */

/**
 * @param {Frame[]} frames to train on, in capture order
 * @param {Float64Array[]} points (N, 3) that each frame sees
 * @param {number} distance typical distance to the scene, for frames without points
 * @param {Object} settings the settings' `keyframes`
 * @returns {number[]} indices of the keyframes, ascending; at least one if there is any frame
 */
export function selectKeyframes(frames, points, distance, settings) {
    const weights = relativeSharpness(frames, settings).map((relative) => relative ** 2);
    const ends = [0, frames.length - 1, Math.min(frames.length, settings.max_views)];
    const looked = [...new Set(evenly(...ends).map(roundedToEven))];
    const views = looked.map((index) => cellsOf(frames[index], points[index], distance, settings));
    const chosen = greedy(views, looked.map((index) => weights[index]), settings);
    return chosen.map((view) => looked[view]).sort((a, b) => a - b);
}

/** At most 1: each frame's sharpness over the median of its neighbours', without itself. */
function relativeSharpness(frames, { sharpness_side: longest, neighbouring_frames: reach }) {
    if (frames.length < 2) {
        return frames.map(() => 1);
    }
    const all = frames.map(({ camera: { width, height }, rgba }) => sharpness({ width, height, rgba }, longest));
    return all.map((own, i) => {
        const around = [...all.slice(Math.max(0, i - reach), i), ...all.slice(i + 1, i + 1 + reach)];
        return Math.min(own / Math.max(medianOf(around), 1e-9), 1);
    });
}

/** @returns {Cells} */
function cellsOf(frame, points, distance, { cells }) {
    const { camera } = frame;
    const { width: columns, height: rows } = inCells(camera, cells);
    const centre = centreOf(camera);
    const depths = cellDepths(camera, points, rows, columns, distance);
    const middles = [];
    for (let cell = 0; cell < rows * columns; cell++) {
        const x = (((cell % columns) + 0.5) * camera.width) / columns;
        const y = ((Math.floor(cell / columns) + 0.5) * camera.height) / rows;
        if (isUsable(frame, Math.floor(y) * camera.width + Math.floor(x))) {
            const position = add(centre, rayOf(camera, x, y), depths[cell]);
            middles.push({ position, footprint: depths[cell] / camera.fx });
        }
    }
    return { camera, centre, rows, columns, depths, middles };
}

/** The depth of the point nearest to each cell in the image. */
function cellDepths(camera, points, rows, columns, distance) {
    const [depths, nearest] = [new Float64Array(rows * columns), new Float64Array(rows * columns)];
    depths.fill(distance);
    nearest.fill(Infinity);
    for (let i = 0; i < points.length; i += 3) {
        const [x, y, depth] = projected(camera, points[i], points[i + 1], points[i + 2]);
        if (!(depth > 0)) {
            continue;
        }
        const [column, row] = [x * (columns / camera.width), y * (rows / camera.height)];
        for (let cell = 0; cell < depths.length; cell++) {
            const square = ((cell % columns) + 0.5 - column) ** 2 + (Math.floor(cell / columns) + 0.5 - row) ** 2;
            if (square < nearest[cell]) {
                [nearest[cell], depths[cell]] = [square, depth];
            }
        }
    }
    return depths;
}

/** The selected views in order. */
function greedy(views, weights, settings) {
    const middles = views.flatMap(({ middles, centre }) => middles.map((middle) => ({ ...middle, from: centre })));
    const seen = views.map((view) => Uint8Array.from(middles, (middle) => sees(view, middle, settings)));
    const wanted = middles.map(() => settings.views);
    const left = views.map(() => true);
    const selected = [];
    while (left.includes(true) && selected.length < settings.max_keyframes) {
        const gains = seen.map((cells) => {
            const gained = cells.reduce((sum, isSeen, i) => sum + isSeen * (wanted[i] > 0), 0);
            return Math.fround(gained / Math.max(middles.length, 1));
        });
        const worth = gains.map((gain, view) => (left[view] ? gain * weights[view] : -1));
        const best = worth.indexOf(Math.max(...worth));
        if (selected.length >= settings.views && gains[best] < settings.least_gain) {
            break;
        }
        selected.push(best);
        left[best] = false;
        copiesOf(views[best], views, seen[best], settings).forEach((isCopy, i) => (left[i] &&= !isCopy));
        seen[best].forEach((isSeen, i) => (wanted[i] -= isSeen));
    }
    return selected;
}

/** Which views are in the same place as a view that sees most of what they see; `seen`: the cells of all of them. */
function copiesOf(view, views, seen, { least_parallax: parallax, copied }) {
    const near = parallax * medianOf(view.depths);
    let first = 0;
    return views.map(({ centre, middles }) => {
        const shared = seen.subarray(first, (first += middles.length)).reduce((sum, isSeen) => sum + isSeen, 0);
        return length(subtract(centre, view.centre)) < near && shared > copied * middles.length;
    });
}

/** Whether a view sees the middle of another view's cell: unhidden, as finely, and from about the same side. */
function sees({ camera, centre, rows, columns, depths }, { position, footprint, from }, settings) {
    const place = projected(camera, ...position);
    if (!isInImage(camera, place)) {
        return false;
    }
    const [x, y, depth] = place;
    const cell = Math.trunc(y * (rows / camera.height)) * columns + Math.trunc(x * (columns / camera.width));
    if (depth >= settings.hidden * depths[cell] || depth / camera.fx >= settings.coarser * footprint) {
        return false;
    }
    let [cosine, own, theirs] = [0, 0, 0];
    for (let axis = 0; axis < 3; axis++) {
        const [a, b] = [position[axis] - centre[axis], position[axis] - from[axis]];
        cosine += a * b;
        own += a * a;
        theirs += b * b;
    }
    return cosine > Math.cos(settings.widest_angle) * Math.sqrt(own) * Math.sqrt(theirs);
}
