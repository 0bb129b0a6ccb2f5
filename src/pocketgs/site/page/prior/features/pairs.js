/**
 * Pairs of views to match: near by pose, consecutive, or similar in appearance; the twin of `prior/features/pairs.py`.
 *
 * @module
 */

import { centreOf, forwardOf } from "../../capture/camera.js";
import { dot, length, subtract } from "../../../page/scene/vectors.js";

/** @typedef {import("../../capture/camera.js").Camera} Camera */

/**
 * @param {string[]} names of the views; in sorted order they are in capture order
 * @param {Camera[]} cameras with given poses
 * @param {number[][]} likeness of the views, see `appearance.js`
 * @param {number} distance typical distance to the scene
 * @param {Object} settings the settings' `pairs`
 * @returns {[number, number][]} indices of two views, the smaller first; sorted and unique
 */
export function choosePairs(names, cameras, likeness, distance, settings) {
    const pairs = new Map();
    const add = (a, b) => pairs.set(`${Math.min(a, b)} ${Math.max(a, b)}`, [Math.min(a, b), Math.max(a, b)]);
    byPose(cameras, distance, settings, add);
    inSequence(names, settings, add);
    byAppearance(likeness, settings, add);
    return [...pairs.values()].sort(([a, b], [c, d]) => a - c || b - d);
}

/**
 * Pairs of views that overlap according to their poses.
 *
 * @param {Camera[]} cameras
 * @param {number} distance typical distance to the scene
 * @param {Object} settings the settings' `pairs`
 * @param {(view: number, other: number) => void} add called for each, for some in both orders
 */
export function byPose(cameras, distance, { ranks, widest_angle: widest }, add) {
    const forwards = cameras.map(forwardOf);
    viewDistances(cameras, cameras, distance).forEach((row, view) => {
        const apart = row.map((value, other) => {
            const isApart = other === view || dot(forwards[view], forwards[other]) < Math.cos(widest);
            return isApart ? Infinity : value;
        });
        const order = sortedBy(apart);
        for (const rank of ranks) {
            if (rank < order.length && apart[order[rank]] < Infinity) {
                add(view, order[rank]);
            }
        }
    });
}

/** Pairs of consecutive frames, by name; numbers in names are compared as numbers. */
function inSequence(names, { steps }, add) {
    const keys = names.map((name) => name.split(/(\d+)/).map((part) => (/^\d+$/.test(part) ? BigInt(part) : part)));
    const order = names.map((_, i) => i).sort((a, b) => compared(keys[a], keys[b]) || a - b);
    for (const step of steps) {
        for (let i = 0; i + step < order.length; i++) {
            add(order[i], order[i + step]);
        }
    }
}

/** Pairs of views with similar features. */
function byAppearance(likeness, { max_similar: most }, add) {
    likeness.forEach((row, view) => {
        const order = sortedBy(row.map((value, other) => (other === view ? Infinity : -value)));
        order.slice(0, most).filter((other) => other !== view && row[other] > 0).forEach((other) => add(view, other));
    });
}

/** Texts and numbers take turns, so that those at one place are of one kind. */
function compared(a, b) {
    for (let i = 0; i < Math.min(a.length, b.length); i++) {
        if (a[i] !== b[i]) {
            return a[i] < b[i] ? -1 : 1;
        }
    }
    return a.length - b.length;
}

/** Indices in the order of their values, equal ones in theirs. @type {(values: number[]) => number[]} */
export const sortedBy = (values) =>
    // Infinities have no difference.
    values.map((_, i) => i).sort((a, b) => (values[a] === values[b] ? a - b : values[a] - values[b]));

/**
 * Distances between views: of their centres relative to that to the scene, plus that of the axes.
 *
 * @param {Camera[]} first
 * @param {Camera[]} second
 * @param {number} distance typical distance to the scene
 * @returns {number[][]} for each of the first one number per second
 */
export function viewDistances(first, second, distance) {
    const traits = (cameras) => cameras.map((camera) => [centreOf(camera), forwardOf(camera)]);
    const others = traits(second);
    return traits(first).map(([centre, forward]) =>
        others.map(([other, axis]) => length(subtract(centre, other)) / distance + length(subtract(forward, axis))),
    );
}
