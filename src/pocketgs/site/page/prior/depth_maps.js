/**
 * Depth maps of all keyframes: source views, depth range and plane sweep for each;
 * the twin of `prior/depth/depth_maps.py`.
 *
 * @module
 */

import { centreOf, rayOf } from "../capture/camera.js";
import { add } from "../../page/scene/vectors.js";
import { evenlyChosen } from "../numbers/evenly.js";
import { depthsOf, narrowed, wideRange } from "./depth_range.js";
import { cameraWithin, frameWithin } from "./photographs.js";
import { completed } from "./sensor_depth.js";
import { chooseSourceViews } from "./source_views.js";

/**
 * @typedef {import("../capture/photograph.js").Frame} Frame
 * @typedef {import("../capture/camera.js").Camera} Camera
 * @typedef {import("./stereo.js").Stereo} Stereo
 * @typedef {import("./stereo.js").DepthMap} DepthMap
 */

/** Maximum number of pixels to sweep per keyframe: with many keyframes, each is swept at a smaller size. */
export const sweptPixels = (keyframes, { max_pixels: most, max_swept_pixels: total }) =>
    Math.min(most, Math.floor(total / Math.max(keyframes, 1)));

/**
 * The depth map of a keyframe.
 *
 * @param {number} keyframe its index
 * @param {Frame[]} frames to train on
 * @param {Float64Array} points (N, 3) that the keyframe sees
 * @param {number} distance typical distance to the scene
 * @param {number} most from `sweptPixels`
 * @param {Object} settings the settings' `prior`
 * @param {Stereo} stereo
 * @returns {Promise<DepthMap>} at the size of the sweep
 */
export async function depthMap(keyframe, frames, points, distance, most, settings, stereo) {
    const cameras = frames.map(({ camera }) => cameraWithin(camera, most));
    const camera = cameras[keyframe];
    const around = representative(camera, points, distance, settings.sweep);
    const chosen = chooseSourceViews(keyframe, cameras, around, settings.sweep);
    const [view, ...sources] = [keyframe, ...chosen].map((index) => frameWithin(frames[index], most));
    const { wide_pixels: few } = settings.depth_range;
    const [small, ...smallSources] = [view, ...sources].map((frame) => frameWithin(frame, few));
    const known = depthsOf(camera, points);
    const wide = wideRange(known, distance, settings.depth_range);
    const first = await stereo.sweep(small, smallSources, wide);
    const sureMargin = Math.fround(settings.sweep.sure_margin);
    const sure = first.depth.filter((depth, i) => depth > 0 && first.margin[i] >= sureMargin);
    const found = Float64Array.from([...sure, ...known]);
    const search = narrowed(wide, found, camera, sources.map((source) => source.camera), settings.depth_range);
    return completed(await stereo.sweep(view, sources, search), view, settings.sensor_depth);
}

/**
 * Points in the view of a camera: some of those that it sees, or a grid at the typical distance.
 *
 * @param {Camera} camera
 * @param {Float64Array} points (N, 3) that it sees
 * @param {number} distance
 * @param {Object} settings the settings' `sweep`
 * @returns {Float64Array} (M, 3)
 */
export function representative(camera, points, distance, { min_points: fewest, max_points: most, grid }) {
    const count = points.length / 3;
    if (count >= fewest) {
        return Float64Array.from(evenlyChosen(count, most).flatMap((i) => [...points.subarray(3 * i, 3 * i + 3)]));
    }
    const centre = centreOf(camera);
    const places = Array.from({ length: grid ** 2 }, (_, i) => [(i % grid) + 0.5, Math.floor(i / grid) + 0.5]);
    const onGrid = places.flatMap(([x, y]) => {
        return add(centre, rayOf(camera, (x * camera.width) / grid, (y * camera.height) / grid), distance);
    });
    return Float64Array.from(onGrid);
}
