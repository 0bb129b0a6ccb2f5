/**
 * Detection of wrong poses: cameras whose matches with the others imply another relative motion; the twin of
 * `prior/poses/suspects.py` and `geometry/agreement.py`, which says why in groups.
 *
 * @module
 */

import { medianOf } from "../../numbers/quantiles.js";
import { essentialOf, givenMotion, raysOf, sampsonDistances } from "../features/epipolar.js";
import { sortedBy, viewDistances } from "../features/pairs.js";
import { positionsOf } from "../features/tracks.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/finder.js").Features} Features
 * @typedef {import("../features/tracks.js").Matches} Matches
 */

/** The smallest distance whose logarithm is taken. */
const TINY = 2 ** -1022;

/** Square tables of numbers, one per pair of views. */
class PairTable {
    constructor(views) {
        this.views = views;
        this.values = new Float64Array(views * views);
    }

    set(first, second, value) {
        this.values[first * this.views + second] = this.values[second * this.views + first] = value;
    }

    at(first, second) {
        return this.values[first * this.views + second];
    }

    /** The sum over the pairs of a view of the one group and a view of the other. */
    between(one, other) {
        return one.reduce((sum, first) => sum + other.reduce((own, second) => own + this.at(first, second), 0), 0);
    }
}

/**
 * Views whose poses contradict those of most others.
 *
 * @param {Camera[]} cameras
 * @param {Features[]} features of the views
 * @param {Matches[]} matches that one motion explains, whatever the poses; none is without any
 * @param {number} tolerance maximum distance in pixels from epipolar lines under correct poses
 * @param {Object<string, number>} settings the settings' `suspects`
 * @returns {boolean[]} one for each view
 */
export function contradicted(cameras, features, matches, tolerance, settings) {
    const { pair_fit: fit, min_support: support, min_matches: least, min_views: views, min_main: share } = settings;
    const [total, supporting] = [new PairTable(cameras.length), new PairTable(cameras.length)];
    for (const { first, second, pairs } of matches) {
        const count = pairs.length / 2;
        const rays = raysOf(cameras[first], cameras[second], ...positionsOf(features, { first, second, pairs }));
        const distances = sampsonDistances(essentialOf(givenMotion(cameras[first], cameras[second])), rays);
        const near = distances.reduce((sum, distance) => sum + (Math.abs(distance) < tolerance), 0);
        total.set(first, second, count);
        supporting.set(first, second, near >= fit * count ? count : 0);
    }
    const groups = groupsOf(cameras.length, matches, total, supporting, support);
    const main = groups.reduce((one, other) => (other.length > one.length ? other : one));
    const found = cameras.map(() => false);
    if (main.length < Math.max(views, share * cameras.length)) {
        return found;
    }
    for (const group of groups.filter((one) => one !== main)) {
        const between = total.between(group, main);
        if (between >= least * group.length && supporting.between(group, main) < support * between) {
            group.forEach((view) => (found[view] = true));
        }
    }
    return found;
}

/** Views by groups whose poses fit each other: merged by pairs, those with most supporting matches first. */
function groupsOf(views, matches, total, supporting, support) {
    const groups = Array.from({ length: views }, (_, view) => [view]);
    const ordered = [...matches].sort((a, b) => a.first - b.first || a.second - b.second);
    ordered.sort((a, b) => supporting.at(b.first, b.second) - supporting.at(a.first, a.second));
    for (const { first, second } of ordered) {
        const [one, other] = [groups[first], groups[second]];
        if (one === other || !supporting.at(first, second)) {
            continue;
        }
        if (supporting.between(one, other) >= support * total.between(one, other)) {
            one.push(...other);
            other.forEach((view) => (groups[view] = one));
        }
    }
    return [...new Set(groups)];
}

/**
 * Views with features but no matches, though views as far apart as their nearest match each other.
 *
 * @param {Camera[]} cameras
 * @param {Features[]} features of the views
 * @param {Matches[]} matches that one motion explains, whatever the poses; none is without any
 * @param {number} distance typical distance to the scene
 * @param {Object<string, number>} settings the settings' `suspects`
 * @returns {boolean[]} one for each view
 */
export function unmatchedViews(cameras, features, matches, distance, settings) {
    const { neighbours, alike_pairs: fewest, alike_share: share, max_chance: most, min_features: least } = settings;
    const matched = new PairTable(cameras.length);
    matches.forEach(({ first, second }) => matched.set(first, second, 1));
    const isMatched = cameras.map((_, view) => cameras.some((_, other) => matched.at(view, other)));
    if (isMatched.filter(Boolean).length <= neighbours) {
        return cameras.map(() => false);
    }
    const apart = viewDistances(cameras, cameras, distance);
    apart.forEach((row, view) => (row[view] = Infinity));
    const nearestOf = (view) => sortedBy(apart[view]).filter((other) => isMatched[other]).slice(0, neighbours);
    const nearest = cameras.map((_, view) => nearestOf(view));
    const logs = nearest.map((near, view) => near.map((other) => Math.log(Math.max(apart[view][other], TINY))));
    const known = logs.filter((_, view) => isMatched[view]).flat();
    const links = nearest.map((near, view) => near.map((other) => matched.at(view, other)));
    const linked = links.filter((_, view) => isMatched[view]).flat();
    const alike = Math.max(fewest, Math.floor(share * known.length));
    const chanceOf = (log) => {
        const pairs = sortedBy(known.map((other) => Math.abs(other - log))).slice(0, alike);
        return 1 - pairs.reduce((sum, pair) => sum + linked[pair], 0) / pairs.length;
    };
    return cameras.map((_, view) => {
        if (isMatched[view]) {
            return false;
        }
        const chance = logs[view].reduce((product, log) => product * chanceOf(log), 1);
        const enough = least * medianOf(nearest[view].map((other) => features[other].count));
        return chance < most && features[view].count >= enough;
    });
}
