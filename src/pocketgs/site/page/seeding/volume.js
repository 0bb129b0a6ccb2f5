/**
 * Random points where the photographs agree, for captures without a cloud; the twin of `prior/cloud/volume.py`: each is
 * drawn on the ray of a random pixel, at the one of a few dozen depths where neighbouring photographs agree best.
 *
 * @module
 */

import { centreOf, forwardOf, rayOf } from "../capture/camera.js";
import { add, dot, normalised, subtract } from "../../page/scene/vectors.js";
import { middleOf } from "../numbers/quantiles.js";
import { Generator } from "../random/generator.js";
import { focusPoint, looksAt } from "./focus.js";
import { outsideHull } from "./visual_hull.js";
import { PatchCosts } from "./patch_costs.js";

/** @typedef {import("../capture/photograph.js").Frame} Frame */

/**
 * @param {Frame[]} frames to train on
 * @param {number} count of points, at most
 * @param {number} seed
 * @param {Object} settings the settings' `volume`
 * @returns {import("../capture/listing.js").Cloud}
 * @throws {Error} no volume is seen by several cameras
 */
export function drawPoints(frames, count, seed, settings) {
    const random = new Generator(seed);
    const cameras = frames.map(({ camera }) => camera);
    const focus = focusPoint(cameras, settings);
    if (frames.length > 1 && !looksAt(cameras, focus)) {
        const found = `the ${frames.length} cameras face outwards and there is no cloud`;
        throw new Error(`${found}: expected a capture with points`);
    }
    const rays = Math.ceil(Math.trunc(count / settings.kept) / frames.length);
    const drawn = frames.flatMap((frame) => {
        return drawFrom(frame, neighboursOf(frame, frames, focus, settings), focus, rays, random, settings);
    });
    const positions = Float64Array.from(drawn.flatMap(({ position }) => position));
    const outside = outsideHull(positions, frames, settings.judging_points);
    const solid = drawn.filter((_, i) => !outside[i]);
    if (solid.length < settings.min_points) {
        throw new Error(
            `no volume is seen by several of the ${frames.length} cameras: are the poses right, and does each photograph ` +
                "show something, not masked or transparent?",
        );
    }
    const best = solid.sort((a, b) => a.rivals - b.rivals).slice(0, count);
    return {
        positions: Float64Array.from(best.flatMap(({ position }) => position)),
        colours: Float32Array.from(best.flatMap(({ colour }) => colour)),
    };
}

/** The frames to compare a frame with: those that see the focus from closest to the best angle away. */
function neighboursOf(frame, frames, focus, { best_angle: best, neighbours }) {
    const direction = ({ camera }) => normalised(subtract(centreOf(camera), focus));
    const own = direction(frame);
    const misfit = (other) => Math.abs(Math.acos(Math.min(Math.max(dot(own, direction(other)), -1), 1)) - best);
    const others = frames.filter((other) => other !== frame).map((other) => [misfit(other), other]);
    return others.sort(([a], [b]) => a - b).slice(0, neighbours).map(([, other]) => other);
}

/** Points on random rays of one frame, and the ratio of the best cost to the typical one: small where it is clear. */
function drawFrom(frame, neighbours, focus, rays, random, settings) {
    const { camera, rgba } = frame;
    const pixels = randomPixels(frame, rays, random);
    const [centre, forward] = [centreOf(camera), forwardOf(camera)];
    const distance = Math.abs(dot(subtract(focus, centre), forward)) || 1;
    const step = (1 / settings.nearest - 1 / settings.farthest) / (settings.depths - 1);
    // Each ray's depths are jittered within their spacing, so that points do not lie in layers.
    const shifts = Array.from(pixels, () => step * random.uniform(-0.5, 0.5));
    const costs = new PatchCosts(frame, neighbours, settings);
    const depths = new Float32Array(settings.depths);
    const points = [];
    pixels.forEach((pixel, ray) => {
        const [column, row] = [pixel % camera.width, Math.floor(pixel / camera.width)];
        depths.forEach((_, i) => (depths[i] = distance / (1 / settings.farthest + i * step + shifts[ray])));
        const found = costs.along(column, row, depths);
        const seen = found.filter(Number.isFinite).sort();
        if (!seen.length) {
            return;
        }
        const depth = depths[found.indexOf(seen[0])];
        const direction = rayOf(camera, column + 0.5, row + 0.5);
        points.push({
            position: add(centre, direction, depth),
            colour: [0, 1, 2].map((channel) => rgba[4 * pixel + channel] / 255),
            // One grey level is added so that noise on even surfaces does not look like a clear choice.
            rivals: (seen[0] + 1) / (middleOf(seen) + 1),
        });
    });
    return points;
}

/** Numbers of random pixels that are neither transparent nor masked. */
function randomPixels({ rgba, mask }, count, random) {
    const isUsable = (i) => rgba[4 * i + 3] > 0 && (mask?.[i] ?? 1) > 0;
    const usable = Array.from({ length: rgba.length / 4 }, (_, i) => i).filter(isUsable);
    return Array.from({ length: usable.length ? count : 0 }, () => usable[random.integer(usable.length)]);
}
