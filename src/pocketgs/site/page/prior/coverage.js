/**
 * Coverage: the parts of the training views that a cloud covers; the twin of `prior/cloud/coverage.py`.
 *
 * @module
 */

import { centreOf, isInImage, projected } from "../capture/camera.js";
import { areaAveraged } from "../numbers/resizing.js";
import { NeighbourTree } from "../seeding/neighbours.js";
import { inCells, isUsable } from "./photographs.js";

/**
 * @typedef {import("../capture/photograph.js").Frame} Frame
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 *
 * @typedef {Object} Cells of a view
 * @property {number[]} centre of the camera
 * @property {Uint8Array} usable whether a cell is not transparent
 * @property {Uint8ClampedArray} colours (R, C, 4) means
 *
 * @typedef {import("../capture/camera.js").Camera & Cells} Grid a view whose pixels are its cells
 */

/** Training views as grids of cells. */
export class ViewCells {
    #settings;

    /**
     * @param {Frame[]} frames
     * @param {Object} settings the settings' `coverage`
     */
    constructor(frames, settings) {
        /** @type {Grid[]} */
        this.grids = frames.map((frame) => gridOf(frame, settings.cells));
        this.#settings = settings;
    }

    /** Depths of uncovered cells: infinite. @type {() => Float32Array[]} */
    empty() {
        return this.grids.map(({ usable }) => new Float32Array(usable.length).fill(Infinity));
    }

    /**
     * Splat points into the depths of the cells that they cover, where they are nearer.
     *
     * @param {Float32Array[]} depths of each view, updated
     * @param {Cloud} points with or without directions
     * @param {ArrayLike<number>} radii in world units
     */
    cover(depths, points, radii) {
        this.grids.forEach((grid, view) => cover(grid, depths[view], points, radii, this.#settings));
    }

    /** Share of covered cells among usable ones. @type {(depths: Float32Array[]) => number} */
    share(depths) {
        let [covered, all] = [0, 0];
        this.grids.forEach(({ usable }, view) => {
            for (let cell = 0; cell < usable.length; cell++) {
                covered += usable[cell] * (depths[view][cell] < Infinity);
                all += usable[cell];
            }
        });
        return all ? covered / all : 0;
    }

    /**
     * Share of the views showing each position in which its cell is uncovered; 0 if no view shows it.
     *
     * @param {Float32Array[]} depths
     * @param {Float64Array} positions (N, 3)
     * @returns {Float64Array}
     */
    uncoveredShare(depths, positions) {
        return Float64Array.from({ length: positions.length / 3 }, (_, i) => {
            let [shown, bare] = [0, 0];
            this.grids.forEach((grid, view) => {
                const { cell } = placeIn(grid, positions, i);
                if (cell >= 0 && grid.usable[cell]) {
                    shown++;
                    bare += depths[view][cell] === Infinity;
                }
            });
            return shown ? bare / shown : 0;
        });
    }
}

/**
 * Mean distance of each point to its nearest neighbours.
 *
 * @param {Float64Array} positions (N, 3)
 * @param {number} neighbours
 * @returns {Float64Array}
 */
export function pointRadii(positions, neighbours) {
    const radii = new Float64Array(positions.length / 3);
    if (radii.length > neighbours) {
        const tree = new NeighbourTree(positions);
        for (let i = 0; i < radii.length; i++) {
            const { squares } = tree.nearest(i, neighbours + 1);
            radii[i] = squares.slice(1).reduce((sum, square) => sum + Math.sqrt(square), 0) / neighbours;
        }
    }
    return radii;
}

/**
 * The cell that shows a position, -1 if none does, and its depth.
 *
 * @param {Grid} grid
 * @param {Float64Array} positions (N, 3)
 * @param {number} i
 * @returns {{cell: number, depth: number}}
 */
export function placeIn(grid, positions, i) {
    const place = projected(grid, positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
    const [column, row, depth] = place;
    const cell = Math.floor(row) * grid.width + Math.floor(column);
    return { cell: isInImage(grid, place) ? cell : -1, depth };
}

/** @returns {Grid} */
function gridOf(frame, cells) {
    const { camera, rgba } = frame;
    const grid = inCells(camera, cells);
    const counted = Uint8Array.from({ length: rgba.length / 4 }, (_, i) => Number(isUsable(frame, i)));
    const shares = areaAveraged(counted, 1, camera, grid);
    return {
        ...grid,
        centre: centreOf(camera),
        usable: Uint8Array.from(shares, (share) => Number(share > 0.5)),
        colours: Uint8ClampedArray.from(areaAveraged(rgba, 4, camera, grid)),
    };
}

function cover(grid, depths, { positions, directions }, radii, { widest_angle: widest, largest }) {
    const { width, height, fx, fy, cx, cy, world_to_camera: m, centre } = grid;
    const least = Math.cos(widest);
    for (let i = 0; i < radii.length; i++) {
        const [x, y, z] = [positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]];
        const depth = m[8] * x + m[9] * y + m[10] * z + m[11];
        if (!(depth > 0)) {
            continue;
        }
        const column = (fx * (m[0] * x + m[1] * y + m[2] * z + m[3])) / depth + cx;
        const row = (fy * (m[4] * x + m[5] * y + m[6] * z + m[7])) / depth + cy;
        // A cell is covered if its middle lies within the radius, or if it contains the point itself.
        const reach = Math.min((radii[i] * fx) / depth, largest) + 0.5;
        if (column < -reach || row < -reach || column > width + reach || row > height + reach) {
            continue;
        }
        if (directions && isFromBehind(directions, i, centre[0] - x, centre[1] - y, centre[2] - z, least)) {
            continue;
        }
        const [left, right] = [Math.ceil(column - reach - 0.5), Math.floor(column + reach - 0.5)];
        const [top, bottom] = [Math.ceil(row - reach - 0.5), Math.floor(row + reach - 0.5)];
        for (let v = Math.max(0, top); v < Math.min(height, bottom + 1); v++) {
            for (let u = Math.max(0, left); u < Math.min(width, right + 1); u++) {
                if (depth < depths[v * width + u]) {
                    depths[v * width + u] = depth;
                }
            }
        }
    }
}

/** Whether a point is seen from another side than it was: unknown directions are 0. */
function isFromBehind(directions, i, dx, dy, dz, least) {
    const [a, b, c] = [directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]];
    const isKnown = a !== 0 || b !== 0 || c !== 0;
    return isKnown && a * dx + b * dy + c * dz < least * Math.sqrt(dx * dx + dy * dy + dz * dz);
}
