/**
 * Validation of refined poses: by points and views that took no part in the adjustment, and by the photographs; the twin
 * of `prior/poses/validation.py`.
 *
 * @module
 */

import { adjustPose } from "../bundle/adjustment.js";
import { countsOf, filtered, indicesWhere, pointsOf, renumbered, selected } from "../features/observations.js";
import { reprojectionErrors, triangulate } from "../features/tracks.js";
import { consensus } from "./consensus.js";
import { correlations } from "./photometric.js";
import { adjustedTo } from "./robust_adjustment.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 * @typedef {import("../../capture/photograph.js").Frame} Frame
 */

/**
 * Which cameras belong to components that adjusted poses explain better, judged by points and views that are held out
 * from an adjustment made for this purpose, and by how alike photographs look around those points.
 *
 * @param {Camera[]} given
 * @param {Observations} tracks sorted by point, including wrong ones
 * @param {Frame[]} frames of the cameras, whose photographs count
 * @param {number} tolerance maximum error of an observation under the given poses, in pixels
 * @param {number} finest errors below this many pixels are noise
 * @param {Object} settings the settings' `poses`, with the `bundle` settings of this scene
 * @returns {boolean[]}
 */
export function validated(given, tracks, frames, tolerance, finest, settings) {
    const { checked_share: share, left_out_share: every } = settings;
    const isChecked = Uint8Array.from(tracks.point, (point) => Number(point % share === 0));
    const absent = given.map((_, view) => view % every === Math.floor(every / 2));
    const taking = renumbered(filtered(tracks, (i) => !isChecked[i] && !absent[tracks.frame[i]]));
    const { cameras, supported: present, tolerance: final } = adjustedTo(given, taking, tolerance, finest, settings);
    // Absent views keep their given poses while the others move: where they see points tells nothing about either.
    const heldOut = renumbered(filtered(tracks, (i) => isChecked[i] && present[tracks.frame[i]]));
    const fitted = filtered(tracks, (i) => !isChecked[i]);
    const poses = [given, cameras];
    const byPoints = poses.map((each) => fitOfPoints(each, heldOut, final, settings));
    const errors = byPoints.map((fit) => fit.errors);
    const byViews = poses.map((each) => errorsOfViews(each, fitted, absent, final, settings));
    const accepted = given.map(() => false);
    for (const part of partsOf(tracks, present.map((isPresent, view) => isPresent || absent[view]))) {
        if (part.filter((isPart, view) => isPart && present[view]).length < settings.min_views) {
            continue;
        }
        const good = goodOf(errors, (i) => part[heldOut.frame[i]], final);
        const [before, after] = truncated(errors, good, final);
        const goodInViews = goodOf(byViews, (i) => part[fitted.frame[i]], final);
        const [viewsBefore, viewsAfter] = truncated(byViews, goodInViews, final);
        // Without points to judge by, errors are NaN and nothing is accepted; views and photographs only confirm.
        if (!(after <= (1 - settings.min_gain) * before) || viewsAfter > viewsBefore) {
            continue;
        }
        const likeness = byPoints.map(({ points }, i) => {
            return correlations(poses[i], frames, heldOut, only(points, good), settings.photometric);
        });
        const [alikeBefore, alikeAfter] = meansOfKnown(likeness, settings.min_observations);
        if (!(alikeAfter < alikeBefore)) {
            part.forEach((isPart, view) => (accepted[view] ||= isPart));
        }
    }
    return accepted;
}

/** How far observations are from the points that two or more others agree on, and those points; NaN without one. */
function fitOfPoints(cameras, tracks, tolerance, settings) {
    const { support, error, others } = consensus(cameras, tracks, tolerance, settings);
    const errors = error.map((value, i) => (support[i] >= 2 ? value : Infinity));
    const points = others.map((value, k) => (support[Math.floor(k / 3)] >= 2 ? value : NaN));
    return { errors, points };
}

/** The observations that are good under either set of poses. */
function goodOf([before, after], isInside, tolerance) {
    return indicesWhere(before.length, (i) => isInside(i) && Math.min(before[i], after[i]) < tolerance);
}

/** RMS errors before and after, truncated at the tolerance, of the good observations; NaN for none. */
function truncated(errors, good, tolerance) {
    return errors.map((each) => {
        return Math.sqrt(good.reduce((sum, i) => sum + Math.min(each[i], tolerance) ** 2, 0) / good.length);
    });
}

/** The points of some observations, NaN for the others. */
function only(points, observations) {
    const kept = new Float64Array(points.length).fill(NaN);
    observations.forEach((i) => kept.set(points.subarray(...span(i)), 3 * i));
    return kept;
}

/** Means before and after, over what is known of both; NaN for few, which are noise. */
function meansOfKnown(values, fewest) {
    const known = indicesWhere(values[0].length, (i) => values.every((each) => Number.isFinite(each[i])));
    if (known.length < fewest) {
        return [NaN, NaN];
    }
    return values.map((each) => known.reduce((sum, i) => sum + each[i], 0) / known.length);
}

/**
 * Errors of the held-out views' observations, after placing each view by one half and judging by the other. The points
 * are those that the other views agree on.
 */
function errorsOfViews(cameras, tracks, absent, tolerance, settings) {
    const errors = new Float64Array(tracks.frame.length).fill(Infinity);
    const positions = agreedPoints(cameras, tracks, absent, tolerance, settings);
    const isKnown = (i) => Number.isFinite(positions[3 * tracks.point[i]]);
    for (const view of indicesWhere(cameras.length, (index) => absent[index])) {
        const own = indicesWhere(errors.length, (i) => tracks.frame[i] === view);
        // The same halves under any poses.
        const [fitted, judged] = [0, 1].map((half) => own.filter((i, place) => place % 2 === half && isKnown(i)));
        if (fitted.length < Math.floor(settings.min_observations / 2)) {
            continue;
        }
        const seen = selected(tracks, fitted);
        const points = Float64Array.from(fitted.flatMap((i) => [...positions.subarray(...span(tracks.point[i]))]));
        const placed = adjustPose(cameras[view], points, seen.pixels, settings.bundle);
        const sightings = { ...selected(tracks, judged), frame: new Int32Array(judged.length) };
        reprojectionErrors([placed], positions, sightings).forEach((error, i) => (errors[judged[i]] = error));
    }
    return errors;
}

const span = (point) => [3 * point, 3 * point + 3];

/** (N, 3) by number of the point, NaN where the views that are not absent agree on none. */
function agreedPoints(cameras, tracks, absent, tolerance, settings) {
    const others = filtered(tracks, (i) => !absent[tracks.frame[i]]);
    const theirs = renumbered(others);
    const { agrees } = consensus(cameras, theirs, tolerance, settings);
    const kept = indicesWhere(agrees.length, (i) => agrees[i]);
    const agreeing = selected(theirs, kept);
    const found = triangulate(cameras, agreeing, settings);
    const views = countsOf(agreeing.point, found.length / 3);
    const positions = new Float64Array(3 * pointsOf(tracks)).fill(NaN);
    kept.forEach((i) => {
        if (views[theirs.point[i]] >= 2) {
            positions.set(found.subarray(...span(theirs.point[i])), 3 * others.point[i]);
        }
    });
    return positions;
}

/** Connected components of the supported cameras, which share points: for each, which cameras belong to it. */
function partsOf({ frame, point }, supported) {
    const labels = supported.map((_, view) => view);
    let last = -1;
    for (let i = 0; i < frame.length; i++) {
        if (!supported[frame[i]]) {
            continue;
        }
        if (last >= 0 && point[last] === point[i]) {
            const [from, to] = [labels[frame[i]], labels[frame[last]]];
            labels.forEach((label, view) => (labels[view] = label === from ? to : label));
        }
        last = i;
    }
    const parts = new Set(labels.filter((_, view) => supported[view]));
    return [...parts].map((part) => labels.map((label, view) => label === part && supported[view]));
}
