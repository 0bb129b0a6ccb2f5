/**
 * Pose refinement: bundle adjustment over all frames, accepted only if it explains held-out points and views better;
 * the twin of `prior/poses/refinement.py`.
 *
 * @module
 */

import { adjustBundle, adjustPose } from "../bundle/adjustment.js";
import {
    countsOf,
    enoughForEachView,
    filtered,
    indicesWhere,
    pointsOf,
    renumbered,
    selected,
} from "../features/observations.js";
import { viewDistances } from "../features/pairs.js";
import { reprojectionErrors, triangulate } from "../features/tracks.js";
import { relativePose } from "../source_views.js";
import { consensus } from "./consensus.js";
import { wellSupported } from "./support.js";
import { nextTolerance } from "./tolerance.js";

/**
 * @typedef {import("../../capture/camera.js").Camera} Camera
 * @typedef {import("../features/observations.js").Observations} Observations
 */

/**
 * Adjust poses, component by component, and keep those that pass validation. Cameras that see too few points are moved
 * with the nearest refined one.
 *
 * @param {Camera[]} given
 * @param {Observations} tracks sorted by point, including wrong ones
 * @param {number} tolerance maximum error of an observation under the given poses, in pixels
 * @param {number} finest errors below this many pixels are noise
 * @param {Object} settings the settings' `poses`, with the `bundle` settings of this scene
 * @param {number} distance typical distance to the scene
 * @returns {Camera[]} the same objects as given where nothing is refined
 */
export function refine(given, tracks, tolerance, finest, settings, distance) {
    const accepted = acceptedViews(given, tracks, tolerance, finest, settings);
    if (!accepted.some(Boolean)) {
        return given;
    }
    const { cameras: adjusted, supported } = adjustedTo(given, tracks, tolerance, finest, settings);
    const moved = accepted.map((isAccepted, view) => isAccepted && supported[view]);
    if (!moved.some(Boolean)) {
        return given;
    }
    const apart = viewDistances(given, given, distance);
    return given.map((camera, view) => {
        if (supported[view]) {
            return moved[view] ? adjusted[view] : camera;
        }
        if (!moved[nearestOf(apart[view], supported)]) {
            return camera;
        }
        const nearest = nearestOf(apart[view], moved);
        return carriedAlong(camera, given[nearest], adjusted[nearest]);
    });
}

/**
 * The camera, keeping its given pose relative to another camera that has been refined.
 *
 * @param {Camera} camera
 * @param {Camera} given the other one before
 * @param {Camera} refined and after
 * @returns {Camera}
 */
export function carriedAlong(camera, given, refined) {
    const { rotation, translation } = relativePose(given, camera);
    const m = refined.world_to_camera;
    const pose = rotation.flatMap((row, i) =>
        [0, 1, 2, 3].map((column) => {
            const turned = row.reduce((sum, value, k) => sum + value * m[4 * k + column], 0);
            return turned + (column === 3 ? translation[i] : 0);
        }),
    );
    return { ...camera, world_to_camera: [...pose, 0, 0, 0, 1] };
}

/** Cameras adjusted to the consistent observations, which of them see enough, and the final tolerance. */
function adjustedTo(given, tracks, tolerance, finest, settings) {
    let [cameras, supported] = [given, given.map(() => false)];
    for (let round = 0; round < settings.rounds; round++) {
        const { agrees } = consensus(cameras, tracks, tolerance, settings);
        const chosen = wellSeen(given, filtered(tracks, (i) => agrees[i]), settings);
        ({ supported } = chosen);
        if (!supported.some(Boolean)) {
            return { cameras: given, supported, tolerance };
        }
        let seen = renumbered(chosen.tracks);
        const points = triangulate(cameras, seen);
        seen = renumbered(filtered(seen, (i) => Number.isFinite(points[3 * seen.point[i]])));
        const result = adjustBundle(given, points.filter(Number.isFinite), seen, settings.bundle, cameras);
        cameras = cameras.map((camera, view) => (supported[view] ? result.cameras[view] : camera));
        const last = tolerance;
        tolerance = nextTolerance(result.residuals, tolerance, finest, settings);
        if (tolerance > 0.8 * last) {
            break;
        }
    }
    return { cameras, supported, tolerance };
}

/** Which cameras are in components that refined poses explain better, by points and views held out from adjustment. */
function acceptedViews(given, tracks, tolerance, finest, settings) {
    const { checked_share: share, left_out_share: every } = settings;
    const isChecked = Uint8Array.from(tracks.point, (point) => Number(point % share === 0));
    const absent = given.map((_, view) => view % every === Math.floor(every / 2));
    const fitted = renumbered(filtered(tracks, (i) => !isChecked[i] && !absent[tracks.frame[i]]));
    const { cameras, supported: present, tolerance: final } = adjustedTo(given, fitted, tolerance, finest, settings);
    const [checked, unchecked] = [1, 0].map((which) => filtered(tracks, (i) => isChecked[i] === which));
    const byPoints = [given, cameras].map((poses) => errorsOfPoints(poses, checked, final, settings));
    const byViews = [given, cameras].map((poses) => errorsOfViews(poses, unchecked, absent, final, settings));
    const accepted = given.map(() => false);
    for (const part of partsOf(tracks, present.map((isPresent, view) => isPresent || absent[view]))) {
        if (part.filter((isPart, view) => isPart && present[view]).length < settings.min_views) {
            continue;
        }
        const isSeen = (i) => part[checked.frame[i]] && present[checked.frame[i]];
        const [before, after] = truncated(byPoints, isSeen, final);
        const [viewsBefore, viewsAfter] = truncated(byViews, (i) => part[unchecked.frame[i]], final);
        // Without points to judge by, errors are NaN and nothing is accepted; views only confirm.
        if (after <= (1 - settings.min_gain) * before && !(viewsAfter > viewsBefore)) {
            part.forEach((isPart, view) => (accepted[view] ||= isPart));
        }
    }
    return accepted;
}

/**
 * RMS errors before and after, truncated at the tolerance, of observations that are good under either set of poses; NaN
 * for none.
 */
function truncated([before, after], isInside, tolerance) {
    const good = indicesWhere(before.length, (i) => isInside(i) && Math.min(before[i], after[i]) < tolerance);
    return [before, after].map((errors) => {
        const squares = good.reduce((sum, i) => sum + Math.min(errors[i], tolerance) ** 2, 0);
        return Math.sqrt(squares / good.length);
    });
}

/** Distances of observations from the point that two or more others agree on; infinite without one. */
function errorsOfPoints(cameras, tracks, tolerance, settings) {
    const { support, error } = consensus(cameras, renumbered(tracks), tolerance, settings);
    return error.map((value, i) => (support[i] >= 2 ? value : Infinity));
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
        const own = indicesWhere(errors.length, (i) => tracks.frame[i] === view && isKnown(i));
        const [fitted, judged] = [0, 1].map((half) => own.filter((_, i) => i % 2 === half));
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
    const found = triangulate(cameras, agreeing);
    const views = countsOf(agreeing.point, found.length / 3);
    const positions = new Float64Array(3 * pointsOf(tracks)).fill(NaN);
    kept.forEach((i) => {
        if (views[theirs.point[i]] >= 2) {
            positions.set(found.subarray(...span(theirs.point[i])), 3 * others.point[i]);
        }
    });
    return positions;
}

/** Enough observations to adjust by, and which cameras have enough of them, well spread. */
function wellSeen(cameras, tracks, settings) {
    const { min_observations: least, observations_per_view: most } = settings;
    let supported = cameras.map(() => true);
    for (let isSettled = false; !isSettled; ) {
        tracks = filtered(tracks, (i) => supported[tracks.frame[i]]);
        const views = countsOf(tracks.point, pointsOf(tracks));
        tracks = filtered(tracks, (i) => views[tracks.point[i]] >= 2);
        const enough = wellSupported(cameras, tracks, least, settings);
        const before = supported;
        supported = before.map((was, view) => was && enough[view]);
        isSettled = supported.every((isSupported, view) => isSupported === before[view]);
    }
    const wanted = enoughForEachView(tracks, cameras.length, most);
    return { tracks: filtered(tracks, (i) => wanted[tracks.point[i]]), supported };
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

function nearestOf(distances, among) {
    const reachable = distances.map((distance, view) => (among[view] ? distance : Infinity));
    return reachable.indexOf(Math.min(...reachable));
}
