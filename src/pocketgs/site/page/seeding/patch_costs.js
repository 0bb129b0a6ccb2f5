/**
 * How well photographs agree along a ray; see `_costs` in `prior/cloud/volume.py`.
 *
 * @module
 */

import { centreOf, rayOf } from "../capture/camera.js";

/** @typedef {import("../capture/photograph.js").Frame} Frame */

/** Compares patches of one frame with their projections in others. */
export class PatchCosts {
    #frame;
    #patch;
    #needed;
    #others;
    #views;

    /**
     * @param {Frame} frame
     * @param {Frame[]} neighbours
     * @param {{patch: number[][], depths: number}} settings offsets in pixels, and how many depths a ray has
     */
    constructor(frame, neighbours, { patch, depths }) {
        const centre = centreOf(frame.camera);
        this.#frame = frame;
        this.#patch = patch;
        this.#needed = patch.length * Math.min(2, Math.max(neighbours.length, 1));
        this.#others = neighbours.map((other) => ({ ...other, start: turned(other.camera, centre, 1) }));
        this.#views = new Uint16Array(depths);
    }

    /**
     * Mean absolute difference, in grey levels, at each depth of a pixel's ray; infinite where fewer than two
     * neighbours (or all, if there are fewer) see the whole patch.
     *
     * @param {number} column
     * @param {number} row
     * @param {Float32Array} depths
     * @returns {Float32Array}
     */
    along(column, row, depths) {
        const { camera, rgba, mask } = this.#frame;
        const totals = new Float32Array(depths.length);
        this.#views.fill(0);
        for (const [right, down] of this.#patch) {
            const x = Math.min(Math.max(column + right, 0), camera.width - 1);
            const y = Math.min(Math.max(row + down, 0), camera.height - 1);
            if (mask?.[y * camera.width + x] === 0) {
                continue;
            }
            const direction = rayOf(camera, x + 0.5, y + 0.5);
            for (const other of this.#others) {
                this.#add(other, turned(other.camera, direction, 0), rgba, 4 * (y * camera.width + x), depths, totals);
            }
        }
        return totals.map((total, i) => (this.#views[i] >= this.#needed ? total / (3 * this.#views[i]) : Infinity));
    }

    #add({ camera, rgba: theirs, mask, start }, [x, y, z], own, pixel, depths, totals) {
        const { width, height, fx, fy, cx, cy } = camera;
        for (let i = 0; i < depths.length; i++) {
            const depth = z * depths[i] + start[2];
            if (!(depth > 0)) {
                continue;
            }
            const column = (fx * (x * depths[i] + start[0])) / depth + cx;
            const row = (fy * (y * depths[i] + start[1])) / depth + cy;
            if (column >= 0 && column < width && row >= 0 && row < height) {
                const place = (row | 0) * width + (column | 0);
                if (mask?.[place] === 0) {
                    continue;
                }
                const at = 4 * place;
                totals[i] +=
                    Math.abs(theirs[at] - own[pixel]) +
                    Math.abs(theirs[at + 1] - own[pixel + 1]) +
                    Math.abs(theirs[at + 2] - own[pixel + 2]);
                this.#views[i]++;
            }
        }
    }
}

/** A direction (`share` 0) or a point (1) in a camera's axes. */
function turned({ world_to_camera: m }, [x, y, z], share) {
    return [0, 4, 8].map((row) => m[row] * x + m[row + 1] * y + m[row + 2] * z + share * m[row + 3]);
}
