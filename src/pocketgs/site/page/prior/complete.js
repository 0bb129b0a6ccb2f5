/**
 * Completion: points where training views show something that no depth map covers;
 * the twin of `prior/cloud/complete.py`.
 *
 * @module
 */

import { rayOf } from "../capture/camera.js";
import { evenlyChosen } from "../numbers/evenly.js";
import { selected } from "../seeding/points.js";
import { add, normalised } from "../../page/scene/vectors.js";
import { pointRadii } from "./coverage.js";
import { pulled } from "./pull_push.js";

/**
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 *
 * @typedef {Object} Completion
 * @property {Cloud} added points for the uncovered parts
 * @property {number} covered share of the training pixels that the cloud and the added points cover together
 */

/**
 * Find points for what training views show and the cloud does not cover: first those of other sources, where the views
 * that show them lack coverage, then points at depths interpolated from their surroundings.
 *
 * @param {Cloud} cloud of fused depths
 * @param {import("./coverage.js").ViewCells} views those to train on
 * @param {Cloud[]} sources other points for what the cloud does not cover, best first
 * @param {number} distance depth for views without any known depth
 * @param {number} count maximum number of points of the whole cloud
 * @param {Object} settings the settings' `coverage`
 * @returns {Completion}
 */
export function completion(cloud, views, sources, distance, count, settings) {
    const depths = views.empty();
    const radiiOf = ({ positions }) => pointRadii(positions, settings.neighbours);
    views.cover(depths, cloud, radiiOf(cloud));
    const fused = cloud.positions.length / 3;
    let room = Math.max(Math.trunc(settings.max_added_share * count), count - fused);
    const found = [];
    for (const all of sources) {
        const source = selected(all, evenlyChosen(all.positions.length / 3, settings.max_source));
        const bare = views.uncoveredShare(depths, source.positions);
        const missing = Array.from(bare, (_, i) => i).filter((i) => bare[i] > settings.missing_share);
        const more = selected(source, evenlyChosen(missing.length, room).map((i) => missing[i]));
        views.cover(depths, more, radiiOf(more));
        found.push(more);
        room -= more.positions.length / 3;
    }
    const guesses = guessed(views, depths, distance);
    const some = selected(guesses, evenlyChosen(guesses.positions.length / 3, room));
    views.cover(depths, some, radiiOf(some));
    return { added: joined([...found, some]), covered: views.share(depths) };
}

/**
 * Clouds one after the other. Missing directions become 0.
 *
 * @param {Cloud[]} clouds
 * @returns {Cloud}
 */
export function joined(clouds) {
    const length = clouds.reduce((sum, { positions }) => sum + positions.length, 0);
    const [positions, colours] = [new Float64Array(length), new Float32Array(length)];
    const directions = new Float32Array(length);
    let at = 0;
    for (const cloud of clouds) {
        positions.set(cloud.positions, at);
        colours.set(cloud.colours, at);
        directions.set(cloud.directions ?? [], at);
        at += cloud.positions.length;
    }
    return { positions, colours, directions };
}

/** Points for uncovered cells, at depths interpolated from their surroundings; the barest views first. */
function guessed(views, covered, distance) {
    const depths = covered.map((one) => one.slice());
    const bareCells = ({ usable }, view) => {
        return Array.from(usable, (_, cell) => cell).filter((cell) => usable[cell] && depths[view][cell] === Infinity);
    };
    const bare = views.grids.map((grid, view) => bareCells(grid, view).length);
    // Equal ones from the last on, as Python turns an ascending order round.
    const order = bare.map((_, view) => view).sort((a, b) => bare[b] - bare[a] || b - a);
    const found = [];
    for (const view of order) {
        const grid = views.grids[view];
        const cells = bareCells(grid, view);
        if (cells.length) {
            const depth = filled(depths[view], grid, distance);
            const points = pointsAt(grid, cells, depth);
            views.cover(depths, points, cells.map((cell) => depth[cell] / grid.fx));
            found.push(points);
        }
    }
    return joined(found);
}

/** Cells as points at depths. */
function pointsAt(grid, cells, depths) {
    const length = 3 * cells.length;
    const points = { positions: new Float64Array(length), colours: new Float32Array(length) };
    points.directions = new Float32Array(length);
    cells.forEach((cell, i) => {
        const ray = rayOf(grid, (cell % grid.width) + 0.5, Math.floor(cell / grid.width) + 0.5);
        points.positions.set(add(grid.centre, ray, depths[cell]), 3 * i);
        points.directions.set(normalised(ray).map((value) => -value), 3 * i);
        for (let channel = 0; channel < 3; channel++) {
            points.colours[3 * i + channel] = grid.colours[4 * cell + channel] / 255;
        }
    });
    return points;
}

/** Depths with the unknown ones interpolated in inverse depth. */
function filled(depths, size, distance) {
    const known = Float32Array.from(depths, (depth) => Number(depth < Infinity));
    if (!known.some((one) => one > 0)) {
        return Float64Array.from(depths, () => distance);
    }
    const inverse = depths.map((depth) => 1 / depth);
    return Float64Array.from(pulled(inverse, known, size), (value) => Math.fround(1 / Math.max(value, 1e-30)));
}
