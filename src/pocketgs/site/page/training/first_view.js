/**
 * From where the scene is shown first, and what it is turned about.
 *
 * @module
 */

import { centreOf, forwardOf } from "../capture/camera.js";
import { focusPoint, looksAt, spreadOf } from "../seeding/focus.js";
import { add, length, normalised, subtract } from "../../page/scene/vectors.js";

/**
 * @typedef {import("../../page/scene/vectors.js").Vector} Vector
 *
 * @param {import("../capture/open.js").Capture} capture
 * @param {Object} settings the settings' `volume`
 * @returns {{camera: import("../capture/camera.js").Camera, rgba: Uint8ClampedArray, target: Vector, up: Vector}} the
 *     first held-out photograph, or where none is held out the first of all
 */
export function firstView({ train, heldOut }, settings) {
    const cameras = train.map(({ camera }) => camera);
    const { camera, rgba } = heldOut[0] ?? train[0];
    const focus = focusPoint(cameras, settings);
    const centres = cameras.map(centreOf);
    const spread = spreadOf(centres) && Math.max(...centres.map((one) => length(subtract(one, centreOf(camera)))));
    // Cameras that face outwards have no common subject.
    const target = looksAt(cameras, focus) ? focus : add(centreOf(camera), forwardOf(camera), spread || 1);
    const upward = cameras.map(({ world_to_camera: m }) => [-m[4], -m[5], -m[6]]);
    const up = normalised(upward.reduce((sum, one) => add(sum, one), [0, 0, 0]));
    return { camera, rgba: rgba.map((value, i) => (i % 4 < 3 ? value : 255)), target, up };
}
