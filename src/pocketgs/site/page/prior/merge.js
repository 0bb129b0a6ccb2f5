/**
 * Merging: from millions of pixels with depths to a cloud of bounded size; the twin of `prior/cloud/merge.py`.
 *
 * @module
 */

import { medianOf } from "../numbers/quantiles.js";
import { roundedToEven } from "../numbers/rounding.js";
import { selected } from "../seeding/points.js";

/**
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 * @typedef {import("./candidates.js").Candidates} Candidates
 */

/** Slots of the table per candidate. */
const ROOM = 2;

/**
 * Average the candidates in each voxel; the voxel size is chosen so that about `count` voxels are filled.
 *
 * @param {Candidates} candidates
 * @param {number} count maximum number of points
 * @param {Object} settings the settings' `merging`
 * @returns {Cloud} with directions
 */
export function merged(candidates, count, settings) {
    if (!candidates.count) {
        const none = new Float32Array(0);
        return { positions: new Float64Array(0), colours: none, directions: none };
    }
    const levels = levelsOf(candidates, settings);
    const { rounds, overfull, sizes_an_octave: sizes } = settings;
    const table = new VoxelTable(candidates, levels, settings);
    let size = 2;
    for (let round = 0; round < rounds; round++) {
        table.fill(size);
        const filled = table.filled;
        if ((count <= filled && filled <= overfull * count) || (filled < count && filled === candidates.count)) {
            break;
        }
        // The number of voxels on a surface grows with the square of the resolution.
        size *= Math.sqrt(filled / (((1 + overfull) / 2) * count));
        size = 2 ** (roundedToEven(sizes * Math.log2(size)) / sizes);
    }
    return heaviest(averaged(candidates, table), count);
}

/** Logarithm of the voxels' relative sides: larger for coarse pixels, smaller where there is detail. */
function levelsOf({ footprints, details, count }, settings) {
    const { min_detail: least, detail_power: power, max_octaves: most, steps_an_octave: steps } = settings;
    const sound = Float64Array.from(details.subarray(0, count), (detail) => Math.max(detail, least));
    const typical = medianOf(sound);
    return Int32Array.from(sound, (detail, i) => {
        const octaves = -power * Math.log2(detail / typical);
        return roundedToEven(steps * (Math.log2(footprints[i]) + Math.min(Math.max(octaves, -most), most)));
    });
}

/** Positions along the axes of the grid, summed in Python's order. */
function turned(positions, count, turn) {
    return Float64Array.from({ length: 3 * count }, (_, i) => {
        const [axis, first] = [3 * (i % 3), i - (i % 3)];
        const across = turn[axis] * positions[first] + turn[axis + 1] * positions[first + 1];
        return across + turn[axis + 2] * positions[first + 2];
    });
}

/** Which voxel each candidate lies in: a hash table with open addressing. */
class VoxelTable {
    /** (N, 3) along the axes of the grid. */
    #positions;
    #levels;
    #lowest;
    #highest;
    #settings;
    #slots;
    /** (N, 3) of each voxel. */
    #cells;
    /** (N,) of each voxel. */
    #voxelLevels;
    /** Number of voxels with candidates. */
    filled = 0;

    constructor({ positions, count }, levels, settings) {
        this.#positions = turned(positions, count, settings.turn);
        this.#levels = levels;
        this.#lowest = levels.reduce((least, level) => Math.min(least, level));
        this.#highest = levels.reduce((most, level) => Math.max(most, level));
        this.#settings = settings;
        this.#slots = new Int32Array(2 ** Math.ceil(Math.log2(ROOM * count)));
        [this.#cells, this.#voxelLevels] = [new Int32Array(3 * count), new Int32Array(count)];
        /** Of each candidate, the number of its voxel. */
        this.voxels = new Uint32Array(count);
    }

    /** Sort the candidates into voxels of a size. */
    fill(size) {
        this.filled = 0;
        this.#slots.fill(-1);
        const [lowest, highest] = [this.#lowest, this.#highest];
        const { steps_an_octave: steps } = this.#settings;
        const sides = Float64Array.from({ length: highest - lowest + 1 }, (_, i) => size * 2 ** ((lowest + i) / steps));
        for (let i = 0; i < this.voxels.length; i++) {
            const side = sides[this.#levels[i] - lowest];
            const x = Math.floor(this.#positions[3 * i] / side);
            const y = Math.floor(this.#positions[3 * i + 1] / side);
            const z = Math.floor(this.#positions[3 * i + 2] / side);
            this.voxels[i] = this.#voxelAt(x, y, z, this.#levels[i]);
        }
    }

    /** @returns {Uint32Array} the voxels by ascending keys, as Python sorts them */
    inOrder() {
        const factors = this.#settings.key_factors.map(BigInt);
        const keys = BigInt64Array.from({ length: this.filled }, (_, voxel) => {
            const level = this.#voxelLevels[voxel] - this.#lowest;
            const place = [...this.#cells.subarray(3 * voxel, 3 * voxel + 3), level];
            return place.reduce((sum, number, i) => sum + BigInt(number) * factors[i], 0n);
        });
        const order = Uint32Array.from(keys, (_, voxel) => voxel);
        return order.sort((a, b) => (keys[a] < keys[b] ? -1 : Number(keys[a] > keys[b])));
    }

    #voxelAt(x, y, z, level) {
        const across = Math.imul(x, 0x9e3779b1) + Math.imul(y, 0x85ebca77) + Math.imul(z, 0xc2b2ae3d);
        const hash = across + Math.imul(level, 0x27d4eb2f);
        const [slots, cells, last] = [this.#slots, this.#cells, this.#slots.length - 1];
        let slot = (hash ^ (hash >>> 15)) & last;
        for (let voxel = slots[slot]; voxel >= 0; voxel = slots[slot]) {
            const isPlace = cells[3 * voxel] === x && cells[3 * voxel + 1] === y && cells[3 * voxel + 2] === z;
            if (isPlace && this.#voxelLevels[voxel] === level) {
                return voxel;
            }
            slot = (slot + 1) & last;
        }
        slots[slot] = this.filled;
        cells[3 * this.filled] = x;
        cells[3 * this.filled + 1] = y;
        cells[3 * this.filled + 2] = z;
        this.#voxelLevels[this.filled] = level;
        return this.filled++;
    }
}

/** Means over the voxels, weighted by confidence, and the weights. */
function averaged(candidates, table) {
    const order = table.inOrder();
    const places = new Uint32Array(table.filled);
    order.forEach((voxel, place) => (places[voxel] = place));
    const weights = new Float64Array(table.filled);
    for (let i = 0; i < candidates.count; i++) {
        weights[places[table.voxels[i]]] += candidates.confidences[i];
    }
    const mean = (values) => {
        const sums = new Float64Array(3 * table.filled);
        for (let i = 0; i < candidates.count; i++) {
            const place = places[table.voxels[i]];
            for (let axis = 0; axis < 3; axis++) {
                sums[3 * place + axis] += values[3 * i + axis] * candidates.confidences[i];
            }
        }
        return sums.map((sum, i) => sum / weights[Math.floor(i / 3)]);
    };
    const directions = mean(candidates.directions);
    for (let i = 0; i < directions.length; i += 3) {
        const norm = Math.max(Math.hypot(directions[i], directions[i + 1], directions[i + 2]), 1e-9);
        [0, 1, 2].forEach((axis) => (directions[i + axis] /= norm));
    }
    const cloud = {
        positions: mean(candidates.positions),
        colours: Float32Array.from(mean(candidates.colours)),
        directions: Float32Array.from(directions),
    };
    return { cloud, weights };
}

/** The points of most weight, in their order. */
function heaviest({ cloud, weights }, count) {
    if (weights.length <= count) {
        return cloud;
    }
    const order = Uint32Array.from(weights, (_, i) => i).sort((a, b) => weights[b] - weights[a] || a - b);
    return selected(cloud, order.slice(0, count).sort());
}
