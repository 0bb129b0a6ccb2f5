/**
 * Relocalising cameras with wrong poses against the points that the other views agree on; the twin of
 * `prior/poses/relocalisation.py`.
 *
 * @module
 */

import { indicesWhere, selected } from "../features/observations.js";
import { byPose, sortedBy } from "../features/pairs.js";
import { link, triangulate } from "../features/tracks.js";
import { agreeing, poseFromPoints } from "./absolute_pose.js";
import { consensus } from "./consensus.js";
import { carriedAlong } from "./refinement.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/finder.js").Features} Features
 * @typedef {import("../features/tracks.js").Matches} Matches
 * @typedef {[number, number]} Pair indices of two views, the smaller first
 *
 * @typedef {Object} Found F views so far
 * @property {Camera[]} cameras
 * @property {Matches[]} matches
 * @property {boolean[]} wrong for each camera whether its pose is wrong
 *
 * @typedef {Object} Scene
 * @property {Features[]} features of the views
 * @property {number[][]} likeness of the views, see `appearance.js`
 * @property {number} tolerance maximum error of an observation in pixels
 * @property {number} distance typical distance to the scene
 */

/** State while wrong views are relocalised. */
export class Relocalisation {
    #given;
    #scene;
    #settings;
    #match;
    /** Pairs that have been matched, as texts. */
    #tried;

    /**
     * @param {Found} found
     * @param {Scene} scene
     * @param {Object} settings the settings' `prior`
     * @param {(cameras: Camera[], pairs: Pair[]) => Promise<Matches[]>} match matches pairs of views
     */
    constructor({ cameras, matches, wrong }, scene, settings, match) {
        this.#given = cameras;
        /** Wrong ones get their new poses as these are found. @type {Camera[]} */
        this.cameras = [...cameras];
        /** More are added on the way. @type {Matches[]} */
        this.matches = [...matches];
        /** Not relocalised so far. @type {boolean[]} */
        this.wrong = [...wrong];
        [this.#scene, this.#settings, this.#match] = [scene, settings, match];
        this.#tried = new Set(matches.map(({ first, second }) => `${first} ${second}`));
    }

    /** Relocalise as many views as possible. */
    async run() {
        await this.#add(this.#alike(), this.cameras);
        for (let round = 0; round < this.#settings.relocalisation.rounds; round++) {
            const known = this.#knownPoints();
            const tried = this.#wrongViews().map((view) => [view, this.#guess(view, known)]);
            const guesses = tried.filter(([, guess]) => guess);
            for (const [view, guess] of guesses) {
                const neighbours = this.#neighbours(view, guess);
                await this.#add(neighbours, this.cameras.with(view, guess));
                const placed = this.#confirmed(view, neighbours, known);
                if (placed) {
                    [this.cameras[view], this.wrong[view]] = [placed, false];
                }
            }
            if (!guesses.length || !this.wrong.some(Boolean)) {
                break;
            }
        }
    }

    #wrongViews() {
        return indicesWhere(this.wrong.length, (view) => this.wrong[view]);
    }

    /** Pairs of every wrong view with the most similar other views. */
    #alike() {
        return this.#wrongViews().flatMap((view) => {
            const row = this.#scene.likeness[view].map((value, other) => (this.wrong[other] ? -1 : value));
            const order = sortedBy(row.map((value) => -value)).slice(0, this.#settings.relocalisation.more_similar);
            return order.filter((other) => row[other] > 0).map((other) => pairOf(view, other));
        });
    }

    /** Pairs of the view with its neighbours if it had this pose. */
    #neighbours(view, guess) {
        const right = indicesWhere(this.wrong.length, (other) => !this.wrong[other]);
        const cameras = [guess, ...right.map((other) => this.cameras[other])];
        const found = new Set();
        byPose(cameras, this.#scene.distance, this.#settings.pairs, (one, other) => {
            if (Math.min(one, other) === 0) {
                found.add(right[Math.max(one, other) - 1]);
            }
        });
        return [...found].map((other) => pairOf(view, other));
    }

    /** Match pairs that have not been matched, with such poses. */
    async #add(pairs, cameras) {
        const isNew = (pair) => !this.#tried.has(pair.join(" ")) && this.#tried.add(pair.join(" "));
        this.matches.push(...(await this.#match(cameras, pairs.filter(isNew))));
    }

    /** For each view (N, 3) points of its features that correct views agree on, NaN where there is none. */
    #knownPoints() {
        const { features, tolerance } = this.#scene;
        const known = features.map(({ count }) => new Float64Array(3 * count).fill(NaN));
        const right = this.matches.filter(({ first, second }) => !this.wrong[first] && !this.wrong[second]);
        const { tracks, feature } = link(features, right);
        const { agrees } = consensus(this.cameras, tracks, tolerance, this.#settings.poses);
        const kept = indicesWhere(agrees.length, (i) => agrees[i]);
        const points = triangulate(this.cameras, selected(tracks, kept), this.#settings.poses);
        for (const i of kept) {
            known[tracks.frame[i]].set(points.subarray(3 * tracks.point[i], 3 * tracks.point[i] + 3), 3 * feature[i]);
        }
        return known;
    }

    /** Different points that the view may see, from matches with correct views. */
    #sightings(view, matches, known) {
        const { pixels } = this.#scene.features[view];
        const seen = new Map();
        for (const { first, second, pairs } of matches) {
            const [other, side] = first === view ? [second, 0] : [first, 1];
            if (this.wrong[other]) {
                continue;
            }
            for (let i = 0; i < pairs.length; i += 2) {
                const [own, theirs] = [pairs[i + side], pairs[i + 1 - side]];
                const point = known[other].subarray(3 * theirs, 3 * theirs + 3);
                if (Number.isFinite(point[0])) {
                    seen.set(`${own} ${point}`, [point, pixels.subarray(2 * own, 2 * own + 2)]);
                }
            }
        }
        const both = [0, 1].map((which) => Float64Array.from([...seen.values()].flatMap((one) => [...one[which]])));
        return { points: both[0], pixels: both[1] };
    }

    /** A pose candidate for the view: from all its matches, or relative to a view that has been relocalised. */
    #guess(view, known) {
        const matches = this.matches.filter(({ first, second }) => first === view || second === view);
        const placed = this.#placed(view, this.#sightings(view, matches, known));
        if (placed) {
            return placed;
        }
        const mates = matches.map(({ first, second, pairs }) => [pairs.length, first === view ? second : first]);
        mates.sort((a, b) => b[0] - a[0] || b[1] - a[1]);
        const moved = mates.find(([, mate]) => this.cameras[mate] !== this.#given[mate]);
        return moved ? carriedAlong(this.#given[view], this.#given[moved[1]], this.cameras[moved[1]]) : null;
    }

    /** The pose that is consistent with the view's new neighbours. */
    #confirmed(view, neighbours, known) {
        const near = new Set(neighbours.map(String));
        const matches = this.matches.filter(({ first, second }) => near.has(String([first, second])));
        const sightings = this.#sightings(view, matches, known);
        const placed = this.#placed(view, sightings);
        if (!placed) {
            return null;
        }
        const fits = agreeing(placed, sightings, 2 * this.#scene.tolerance);
        const share = fits.pixels.length / sightings.pixels.length;
        return share >= this.#settings.relocalisation.min_fit ? placed : null;
    }

    #placed(view, sightings) {
        return poseFromPoints(this.#given[view], sightings, 2 * this.#scene.tolerance, this.#settings);
    }
}

const pairOf = (one, other) => [Math.min(one, other), Math.max(one, other)];
