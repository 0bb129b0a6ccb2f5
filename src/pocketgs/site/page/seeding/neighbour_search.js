/**
 * Nearest neighbours on the GPU; the twin of `seeding/webgpu/search.py`.
 *
 * @module
 */

import { Description } from "../../gpu/description.js";
import { Executor } from "../../gpu/executor.js";
import { medianOf } from "../numbers/quantiles.js";

/**
 * @typedef {Object} Neighbourhoods the surroundings of N points
 * @property {Float64Array} spacing (N,) mean distance to the three nearest neighbours
 * @property {Float32Array} normals (N, 3) of the plane through the nearest neighbours
 * @property {Float32Array} tangents (N, 3) the direction in which these spread most
 */

/** Finds the nearest neighbours of points, exactly. It holds the GPU's memory only while it searches. */
export class NeighbourSearch {
    #executor;
    #settings;

    /**
     * Compile what the search needs.
     *
     * @param {GPUDevice} device
     * @param {Object} passes from `seeding_passes.json`
     * @param {{leaf: number, most_neighbours: number}} settings the settings' `seeding`
     * @returns {Promise<NeighbourSearch>}
     */
    static async open(device, passes, settings) {
        const search = new NeighbourSearch(device, passes, settings);
        await search.#executor.prepare();
        return search;
    }

    constructor(device, passes, settings) {
        this.#executor = new Executor(device, new Description(passes));
        this.#settings = settings;
    }

    /**
     * The neighbourhood of every point.
     *
     * @param {Float64Array} positions (N, 3), along a Morton curve
     * @returns {Promise<Neighbourhoods>}
     * @throws {Error} the GPU's memory does not hold it
     */
    async around(positions) {
        const [executor, points] = [this.#executor, positions.length / 3];
        const { centred, unit } = placed(positions);
        const numbers = numbersOf(points, this.#settings);
        await executor.reserve(executor.description.sizes(numbers));
        executor.write("positions", centred);
        executor.writeUniform("cloud", numbers);
        executor.submit("look around", numbers);
        const spacing = await executor.read("spacing", Float32Array, points);
        const normals = await executor.read("normals", Float32Array, 3 * points);
        const tangents = await executor.read("tangents", Float32Array, 3 * points);
        executor.free();
        return { spacing: Float64Array.from(spacing, (distance) => unit * distance), normals, tangents };
    }
}

/** Positions around 0, where single precision is best, in a unit in which no square of a distance vanishes. */
function placed(positions) {
    const middle = [0, 1, 2].map((axis) => medianOf(positions.filter((_, i) => i % 3 === axis)));
    const centred = positions.map((value, i) => value - middle[i % 3]);
    const unit = centred.reduce((most, value) => Math.max(most, Math.abs(value)), 0) || 1;
    return { centred: Float32Array.from(centred, (value) => value / unit), unit };
}

/** The fields of `tree.wgsl` for so many points. */
function numbersOf(points, { leaf, most_neighbours: most }) {
    const leaves = 1 << (32 - Math.clz32(Math.ceil(points / leaf) - 1));
    return { points, neighbours: Math.min(most, points), leaves };
}
