/**
 * Learning rates of an iteration; the twin of `rates_for` in `training/recipes.py`. The schedule is data.
 *
 * @module
 */

import { isInImage, projected } from "../capture/camera.js";
import { middleOf } from "../numbers/quantiles.js";

/** @typedef {Object<string, number>} Rates by the names of `LearningRates` */

/**
 * The initial rates of a run.
 *
 * @param {Object} recipe
 * @param {number} iterations
 * @param {number} unit from `pixelFootprint`
 * @returns {Rates}
 */
export function initialRates({ rates, scales_for: tuned, slowest_scales: slowest }, iterations, unit) {
    const slower = tuned ? Math.min(Math.max(Math.sqrt(tuned / iterations), slowest), 1) : 1;
    return { ...rates, means: rates.means * unit, log_scales: rates.log_scales * slower };
}

/**
 * The rates at a share of the run.
 *
 * @param {Rates} initial
 * @param {Object<string, number[]>} schedule by what each rate is multiplied, at equal steps of the run
 * @param {number} progress from 0 to 1
 * @returns {Rates}
 */
export function ratesAt(initial, schedule, progress) {
    const rates = Object.entries(initial).map(([name, rate]) => {
        const factors = schedule[name];
        const place = Math.min(progress, 1) * (factors.length - 1);
        const below = Math.min(Math.floor(place), factors.length - 2);
        return [name, rate * (factors[below] + (place - below) * (factors[below + 1] - factors[below]))];
    });
    return Object.fromEntries(rates);
}

/**
 * Footprint of a pixel at the scene: the median over cameras and points that they see of depth / focal length.
 *
 * @param {import("../capture/camera.js").Camera[]} cameras
 * @param {Float64Array} positions (N, 3) of the points
 * @param {number} most how many depths are looked at; of more points, every second one or fewer are taken
 * @returns {number}
 * @throws {Error} no camera sees a point
 */
export function pixelFootprint(cameras, positions, most) {
    const points = positions.length / 3;
    const stride = 1 + Math.floor((cameras.length * points) / most);
    const ratios = new Float64Array(cameras.length * Math.ceil(points / stride));
    let seen = 0;
    for (const camera of cameras) {
        const focal = Math.sqrt(camera.fx * camera.fy);
        for (let i = 0; i < positions.length; i += 3 * stride) {
            const place = projected(camera, positions[i], positions[i + 1], positions[i + 2]);
            if (isInImage(camera, place)) {
                ratios[seen++] = place[2] / focal;
            }
        }
    }
    if (!seen) {
        throw new Error(`none of the ${cameras.length} cameras sees any of the ${points} points: are the poses right?`);
    }
    return middleOf(ratios.subarray(0, seen).sort());
}
