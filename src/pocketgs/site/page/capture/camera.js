/**
 * Cameras that files state: checked, and in OpenCV axes with pixel centres at + 0.5; see `capture/poses.py`.
 *
 * @module
 */

import { axesOf, cross, dot, unit } from "../../page/scene/vectors.js";

/** @typedef {import("../../page/scene/camera.js").Camera} Camera */

/**
 * Make a camera from numbers that a file states.
 *
 * @param {string} where file and frame, for messages
 * @param {{size: number[], focal: number[], centre: number[]}} intrinsics in pixels
 * @param {number[]} rotation world to camera, 3 x 3 row by row, from `exactRotation` or `rotationOf`
 * @param {number[]} translation
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {Camera}
 * @throws {Error} a number is not usable
 */
export function cameraAt(where, { size, focal, centre }, rotation, translation, bounds) {
    if (!size.every((side) => side >= 1 && side <= 2 ** 24)) {
        throw new Error(`${where}: image size ${size.join("x")}, expected 1 to ${2 ** 24} pixels a side`);
    }
    if (!focal.every((value) => value >= bounds.min_focal_length && value <= bounds.max_intrinsic)) {
        throw new Error(`${where}: focal lengths ${focal.join(", ")}, expected positive numbers of pixels`);
    }
    if (!centre.every((value) => Math.abs(value) <= bounds.max_intrinsic)) {
        throw new Error(`${where}: principal point ${centre.join(", ")}, expected pixels of the image`);
    }
    if (!translation.every((value) => Math.abs(value) < bounds.max_coordinate)) {
        throw new Error(`${where}: the pose holds NaN or coordinates beyond ${bounds.max_coordinate}`);
    }
    const pose = [0, 1, 2].flatMap((row) => [...rotation.slice(3 * row, 3 * row + 3), translation[row]]);
    const [[width, height], [fx, fy], [cx, cy]] = [size.map(Math.round), focal, centre];
    return { width, height, fx, fy, cx, cy, world_to_camera: [...pose, 0, 0, 0, 1] };
}

/**
 * The rotation nearest to one that is off by rounding.
 *
 * @param {string} where file and frame, for messages
 * @param {number[]} rotation 3 x 3 row by row
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {number[]} 3 x 3 row by row
 * @throws {Error} it is no rotation
 */
function exactRotation(where, rotation, bounds) {
    const rows = [0, 3, 6].map((first) => rotation.slice(first, first + 3));
    const product = rows.flatMap((a, i) => rows.map((b, j) => dot(a, b) - (i === j ? 1 : 0)));
    if (!(Math.max(...product.map(Math.abs)) <= bounds.rotation_tolerance)) {
        throw new Error(`${where}: the pose is not rigid, expected a rotation without scale or shear`);
    }
    if (determinant(rows) < 0) {
        throw new Error(`${where}: the pose mirrors the scene, expected a rotation with determinant +1`);
    }
    return nearestRotation(rows).flat();
}

/** Signs of the axes x right, y down, z forward in files whose cameras have x right, y up, z back. */
export const UP_AND_BACK = [1, -1, -1];

/**
 * World to camera of a pose that is stated from camera to world.
 *
 * @param {string} where file and frame, for messages
 * @param {number[][]} axes three rows, whose first three numbers are a rotation
 * @param {number[]} centre of the camera
 * @param {number[]} signs of the file's axes, such as `UP_AND_BACK`
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {[number[], number[]]} rotation, row by row, and translation
 * @throws {Error} it is no rotation
 */
export function inverted(where, axes, centre, signs, bounds) {
    const rows = signs.flatMap((sign, column) => [0, 1, 2].map((row) => sign * axes[row][column]));
    const rotation = exactRotation(where, rows, bounds);
    const turned = (first) => centre.reduce((sum, value, i) => sum + rotation[first + i] * value, 0);
    return [rotation, [0, 3, 6].map((first) => -turned(first))];
}

/** The view of an image without a border. @type {(camera: Camera, border: number) => Camera} */
export function cropped(camera, border) {
    const [width, height] = [camera.width - 2 * border, camera.height - 2 * border];
    return { ...camera, width, height, cx: camera.cx - border, cy: camera.cy - border };
}

/** The same view in an image of another size. @type {(camera: Camera, width: number, height: number) => Camera} */
export function resized(camera, width, height) {
    const [across, down] = [width / camera.width, height / camera.height];
    const { fx, fy, cx, cy } = camera;
    return { ...camera, width, height, fx: fx * across, fy: fy * down, cx: cx * across, cy: cy * down };
}

/** Position in the world. @type {(camera: Camera) => [number, number, number]} */
export function centreOf({ world_to_camera: m }) {
    return [0, 1, 2].map((axis) => -(m[axis] * m[3] + m[4 + axis] * m[7] + m[8 + axis] * m[11]));
}

/** Unit vector along the optical axis. @type {(camera: Camera) => [number, number, number]} */
export const forwardOf = ({ world_to_camera: m }) => [m[8], m[9], m[10]];

/**
 * Column, row and depth of a point; the depth is positive in front of the camera.
 *
 * @param {Camera} camera
 * @param {number} x
 * @param {number} y
 * @param {number} z
 * @returns {[number, number, number]}
 */
export function projected({ fx, fy, cx, cy, world_to_camera: m }, x, y, z) {
    const depth = m[8] * x + m[9] * y + m[10] * z + m[11];
    const safe = Math.abs(depth) > 1e-12 ? depth : 1e-12;
    const column = (fx * (m[0] * x + m[1] * y + m[2] * z + m[3])) / safe + cx;
    const row = (fy * (m[4] * x + m[5] * y + m[6] * z + m[7])) / safe + cy;
    return [column, row, depth];
}

/**
 * Whether an image shows a point.
 *
 * @param {{width: number, height: number}} size of the image
 * @param {[number, number, number]} place column, row and depth, from `projected`
 * @returns {boolean}
 */
export function isInImage({ width, height }, [column, row, depth]) {
    return depth > 0 && column >= 0 && column < width && row >= 0 && row < height;
}

/** World direction of a place in the image, of length 1 along the optical axis. */
export function rayOf({ fx, fy, cx, cy, world_to_camera: m }, column, row) {
    const [x, y] = [(column - cx) / fx, (row - cy) / fy];
    return [0, 1, 2].map((axis) => x * m[axis] + y * m[4 + axis] + m[8 + axis]);
}

/**
 * World to camera of a recording's frame: a camera to world quaternion and a position.
 *
 * @param {string} where file and frame, for messages
 * @param {number[]} numbers x, y, z, w of the quaternion
 * @param {number[]} centre of the camera
 * @param {number[]} signs of the file's axes, as for `inverted`
 * @param {Object<string, number>} bounds the settings' `capture`
 * @returns {[number[], number[]]} rotation, row by row, and translation
 * @throws {Error} the quaternion is zero or not finite
 */
export function invertedQuaternion(where, [x, y, z, w], centre, signs, bounds) {
    const rotation = rotationOf(where, [w, x, y, z]);
    return inverted(where, [0, 3, 6].map((first) => rotation.slice(first, first + 3)), centre, signs, bounds);
}

/**
 * Rotation of a quaternion w, x, y, z of any length, row by row.
 *
 * @param {string} where file and frame, for messages
 * @param {number[]} quaternion
 * @returns {number[]}
 * @throws {Error} it is zero or not finite
 */
export function rotationOf(where, quaternion) {
    const length = Math.hypot(...quaternion);
    if (!(length > 0 && length < Infinity)) {
        throw new Error(`${where}: rotation quaternion ${quaternion.join(", ")}, expected finite and not zero`);
    }
    const axes = axesOf(unit(quaternion));
    return [0, 1, 2].flatMap((row) => axes.map((axis) => axis[row]));
}

const determinant = ([a, b, c]) => dot(a, cross(b, c));

/** The orthogonal factor of the polar decomposition, by Newton's iteration R ← (R + R⁻ᵀ) / 2 (Higham 1986). */
function nearestRotation(rows) {
    let nearest = rows;
    for (let round = 0; round < 8; round++) {
        const [a, b, c] = nearest;
        const share = determinant(nearest);
        const cofactors = [cross(b, c), cross(c, a), cross(a, b)];
        nearest = nearest.map((row, i) => row.map((value, j) => (value + cofactors[i][j] / share) / 2));
    }
    return nearest;
}
