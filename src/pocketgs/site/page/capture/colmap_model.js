/**
 * What COLMAP's sparse models hold, in text or binary; see `capture/formats/colmap_model.py`.
 *
 * @module
 */

import { lensOf } from "./lens.js";

/**
 * @typedef {{number: number, name: string, parameters: string[], fisheye: boolean}} CameraModel
 *
 * @typedef {Object} ColmapCamera
 * @property {number[]} size width and height
 * @property {number[]} focal
 * @property {number[]} centre
 * @property {import("./lens.js").Lens} lens
 *
 * @typedef {Object} ColmapImage
 * @property {string} name
 * @property {number} cameraId
 * @property {number[]} quaternion w, x, y, z of world to camera
 * @property {number[]} translation
 */

/**
 * @param {CameraModel} model
 * @param {number[]} size
 * @param {number[]} values of its parameters
 * @param {string} where for messages
 * @returns {ColmapCamera}
 */
export function cameraFrom(model, size, values, where) {
    if (!values.every(Number.isFinite)) {
        throw new Error(`${where}: parameters ${values.join(", ")}, expected finite numbers`);
    }
    const named = Object.fromEntries(model.parameters.map((name, i) => [name, values[i]]));
    return {
        size,
        focal: [named.fx ?? named.f, named.fy ?? named.f],
        centre: [named.cx, named.cy],
        lens: lensOf(model.fisheye, (name) => named[name]),
    };
}

/**
 * @param {string} where
 * @param {string} found
 * @param {CameraModel[]} models those that are known
 * @returns {Error}
 */
export function unknownModel(where, found, models) {
    const known = models.map(({ name }) => name).join(", ");
    return new Error(`${where}: camera model ${found}, expected one of ${known}; undistort with COLMAP first`);
}
