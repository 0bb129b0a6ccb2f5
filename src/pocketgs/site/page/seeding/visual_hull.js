/**
 * The visual hull of the silhouettes in transparent images; the twin of `prior/cloud/visual_hull.py`.
 *
 * @module
 */

import { isInImage, projected } from "../capture/camera.js";

/** @typedef {import("../capture/photograph.js").Frame} Frame */

const UNSEEN = 0;
const OPAQUE = 1;
const TRANSPARENT = 2;

/**
 * Whether points project to transparent pixels of some image with alpha. Images that do not see a point say nothing of
 * it, and those that lost the object when they were cut out say nothing at all.
 *
 * @param {Float64Array} positions (N, 3)
 * @param {Frame[]} frames
 * @param {number} judging number of points, at most, on which silhouettes are compared with each other
 * @returns {Uint8Array} (N,) 1 for those outside
 */
export function outsideHull(positions, frames, judging) {
    const silhouettes = withTheObject(frames.filter(({ hasAlpha }) => hasAlpha), positions, judging);
    return Uint8Array.from({ length: positions.length / 3 }, (_, point) => {
        return silhouettes.some((frame) => shownAt(positions, point, frame) === TRANSPARENT);
    });
}

/** Frames whose cut-out kept the object: opaque at half or more of the points where most frames are. */
function withTheObject(frames, positions, judging) {
    const count = positions.length / 3;
    const stride = 1 + Math.floor(count / judging);
    const some = Uint32Array.from({ length: Math.ceil(count / stride) }, (_, i) => i * stride);
    const shown = frames.map((frame) => Uint8Array.from(some, (point) => shownAt(positions, point, frame)));
    const mostlyOpaque = some.map((_, i) => {
        const [seen, transparent] = [UNSEEN, OPAQUE].map((less) => shown.filter((own) => own[i] > less).length);
        return 2 * transparent < seen;
    });
    return frames.filter((_, index) => {
        const ofObject = shown[index].filter((what, i) => mostlyOpaque[i] && what !== UNSEEN);
        return 2 * ofObject.filter((what) => what === TRANSPARENT).length <= ofObject.length;
    });
}

/** What a frame shows at a point. */
function shownAt(positions, point, { camera, rgba }) {
    const place = projected(camera, positions[3 * point], positions[3 * point + 1], positions[3 * point + 2]);
    if (!isInImage(camera, place)) {
        return UNSEEN;
    }
    const [column, row] = place.map(Math.floor);
    return rgba[4 * (row * camera.width + column) + 3] === 0 ? TRANSPARENT : OPAQUE;
}
