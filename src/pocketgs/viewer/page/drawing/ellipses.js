/**
 * The ellipses that points appear as in an image, and their order by depth.
 *
 * @module
 */

import { ALPHA_MIN, LOW_PASS } from "../constants.js";
import { slopeBounds } from "./view_values.js";

/**
 * @typedef {import("../scene/camera.js").Camera} Camera
 * @typedef {import("./points.js").Points} Points
 */

/** Maximum radius, at the edge, as a share of the image's longer side. */
const MAX_RADIUS = 0.25;

/** Depths are sorted by the upper bits of their floating-point numbers: to 1/1024. */
const LOST_BITS = 13;
const KEYS = 1 << (31 - LOST_BITS);

/** Numbers of an ellipse. */
export const WORDS = 8;

/** Ellipses in view. */
export class Ellipses {
    count = 0;
    /**
     * (count, 8): the centre's x and y in pixels; xx, xy and yy of the inverse covariance Σ'⁻¹; the opacity; the extent
     * q = dᵀ Σ'⁻¹ d at the edge, where the opacity has fallen to 1/255; and the height of the upper half.
     */
    numbers = new Float32Array(0);
    /** (count,) of the points. */
    indices = new Uint32Array(0);
    #depths = new Float32Array(0);
    #starts = new Uint32Array(KEYS + 1);

    /**
     * Find the ellipses in view.
     *
     * @param {Points} points
     * @param {Camera} camera
     */
    find(points, camera) {
        if (this.indices.length < points.count) {
            this.numbers = new Float32Array(WORDS * points.count);
            this.indices = new Uint32Array(points.count);
            this.#depths = new Float32Array(points.count);
        }
        this.count = 0;
        const bounds = slopeBounds(camera);
        const { x, y, z, opacities, near } = points;
        const m = camera.world_to_camera;
        for (let i = 0; i < points.count; i++) {
            const depth = m[8] * x[i] + m[9] * y[i] + m[10] * z[i] + m[11];
            if (opacities[i] > 0 && depth >= near) {
                const across = (m[0] * x[i] + m[1] * y[i] + m[2] * z[i] + m[3]) / depth;
                const down = (m[4] * x[i] + m[5] * y[i] + m[6] * z[i] + m[7]) / depth;
                this.#add(points, i, camera, bounds, across, down, depth);
            }
        }
    }

    /** Numbers of the ellipses by depth: a counting sort. @returns {Uint32Array} */
    nearestFirst() {
        const bits = new Uint32Array(this.#depths.buffer, 0, this.count);
        const starts = this.#starts.fill(0);
        for (let i = 0; i < this.count; i++) {
            starts[(bits[i] >>> LOST_BITS) + 1]++;
        }
        for (let key = 0; key < KEYS; key++) {
            starts[key + 1] += starts[key];
        }
        const order = new Uint32Array(this.count);
        for (let i = 0; i < this.count; i++) {
            order[starts[bits[i] >>> LOST_BITS]++] = i;
        }
        return order;
    }

    /** Project a point: Σ' = J W Σ Wᵀ Jᵀ + 0.3 I (3DGS, equation 5), as in `project.wgsl`. */
    #add({ covariances, opacities }, i, camera, bounds, across, down, depth) {
        const { width, height, fx, fy, cx, cy, world_to_camera: m } = camera;
        const at = 6 * i;
        const [xx, xy, xz] = [covariances[at], covariances[at + 1], covariances[at + 2]];
        const [yy, yz, zz] = [covariances[at + 3], covariances[at + 4], covariances[at + 5]];
        // At slopes within the bounds: far outside the image the linearisation explodes.
        const slopeX = Math.min(Math.max(across, bounds.low[0]), bounds.high[0]);
        const slopeY = Math.min(Math.max(down, bounds.low[1]), bounds.high[1]);
        // No ellipse is the image of what lies beside the view and reaches the camera's plane.
        if ((slopeX !== across || slopeY !== down) && xx + yy + zz > depth * depth) {
            return;
        }
        // Rows of J W.
        const [u, v] = [fx / depth, fy / depth];
        const [px, py, pz] = [u * (m[0] - slopeX * m[8]), u * (m[1] - slopeX * m[9]), u * (m[2] - slopeX * m[10])];
        const [qx, qy, qz] = [v * (m[4] - slopeY * m[8]), v * (m[5] - slopeY * m[9]), v * (m[6] - slopeY * m[10])];
        const [sx, sy, sz] = [xx * px + xy * py + xz * pz, xy * px + yy * py + yz * pz, xz * px + yz * py + zz * pz];
        const [tx, ty, tz] = [xx * qx + xy * qy + xz * qz, xy * qx + yy * qy + yz * qz, xz * qx + yz * qy + zz * qz];
        let a = sx * px + sy * py + sz * pz + LOW_PASS;
        let b = sx * qx + sy * qy + sz * qz;
        let c = tx * qx + ty * qy + tz * qz + LOW_PASS;
        const edge = 2 * Math.log(opacities[i] / ALPHA_MIN);
        const most = (MAX_RADIUS * Math.max(width, height)) ** 2 / edge;
        if ((a + c) / 2 + Math.hypot((a - c) / 2, b) > most) {
            [a, b, c] = shortened(a, b, c, most);
        }
        const determinant = a * c - b * b;
        const [x, y] = [cx + fx * across, cy + fy * down];
        const [reachX, reachY] = [Math.sqrt(edge * a), Math.sqrt(edge * c)];
        const isInside = x + reachX > 0 && x - reachX < width && y + reachY > 0 && y - reachY < height;
        if (isInside && determinant > 0) {
            const { numbers, count } = this;
            const first = WORDS * count;
            [numbers[first], numbers[first + 1]] = [x, y];
            numbers[first + 2] = c / determinant;
            numbers[first + 3] = -b / determinant;
            numbers[first + 4] = a / determinant;
            [numbers[first + 5], numbers[first + 6], numbers[first + 7]] = [opacities[i], edge, reachY];
            this.#depths[count] = depth;
            this.indices[count] = i;
            this.count++;
        }
    }
}

/** A covariance with the same axes whose variances along them are `most` at most; one is larger. */
function shortened(a, b, c, most) {
    const [middle, half] = [(a + c) / 2, Math.hypot((a - c) / 2, b)];
    const shorter = Math.min(middle - half, most);
    const share = half > 0 ? (most - shorter) / (2 * half) : 0;
    const shift = (most + shorter) / 2 - share * middle;
    return [share * a + shift, share * b, share * c + shift];
}
