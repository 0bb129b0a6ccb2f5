/**
 * What frames see where no cloud says so, from full-range sweeps of small copies; the twin of `prior/rough_points.py`.
 *
 * @module
 */

import { centreOf, rayOf } from "../capture/camera.js";
import { add } from "../../page/scene/vectors.js";
import { evenlyChosen } from "../numbers/evenly.js";
import { representative } from "./depth_maps.js";
import { wideRange } from "./depth_range.js";
import { frameWithin } from "./photographs.js";
import { chooseSourceViews } from "./source_views.js";

const UNKNOWN = new Float64Array(0);

/**
 * For each frame some of the points that a sweep of a small copy is sure of.
 *
 * @param {import("../capture/photograph.js").Frame[]} frames
 * @param {number} distance typical distance to the scene, by which source views and the nearest depth are chosen
 * @param {Object} settings the settings' `prior`
 * @param {import("./stereo.js").Stereo} stereo
 * @param {(done: number) => Promise<void>} onProgress called before each frame
 * @returns {Promise<Float64Array[]>} (N, 3) positions
 */
export async function roughPoints(frames, distance, settings, stereo, onProgress) {
    const { sweep, depth_range: ranges, seen_points: most } = settings;
    const small = frames.map((frame) => frameWithin(frame, ranges.wide_pixels));
    const cameras = small.map(({ camera }) => camera);
    const wide = wideRange(UNKNOWN, distance, ranges);
    const found = [];
    for (const [index, frame] of small.entries()) {
        await onProgress(index);
        const around = representative(frame.camera, UNKNOWN, distance, sweep);
        const sources = chooseSourceViews(index, cameras, around, sweep).map((other) => small[other]);
        const { depth, margin } = await stereo.sweep(frame, sources, wide);
        const sure = Array.from(depth, (_, i) => i).filter((i) => {
            return depth[i] > 0 && margin[i] >= Math.fround(sweep.sure_margin);
        });
        const some = evenlyChosen(sure.length, most.max_seen).map((i) => sure[i]);
        found.push(pointsAt(frame.camera, depth, some));
    }
    return found;
}

/** Points at the depths of pixels. */
function pointsAt(camera, depth, pixels) {
    const centre = centreOf(camera);
    const positions = pixels.flatMap((i) => {
        return add(centre, rayOf(camera, (i % camera.width) + 0.5, Math.floor(i / camera.width) + 0.5), depth[i]);
    });
    return Float64Array.from(positions);
}
