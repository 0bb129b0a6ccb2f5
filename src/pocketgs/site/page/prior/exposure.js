/**
 * Exposure: the gains between photographs of the same surfaces, and photographs brought to their mean; the twin of
 * `prior/exposure.py`.
 *
 * @module
 */

import { isInImage, projected } from "../capture/camera.js";
import { mirrored } from "../numbers/mirrored.js";
import { medianOf } from "../numbers/quantiles.js";
import { roundedToEven } from "../numbers/rounding.js";
import { Generator } from "../random/generator.js";
import { enoughForEachView } from "./features/observations.js";
import { sortedBy, viewDistances } from "./features/pairs.js";

/**
 * @typedef {import("../capture/photograph.js").Frame} Frame
 * @typedef {import("./poses/structure.js").Structure} Structure
 */

const CHANNELS = [0, 1, 2];

/**
 * How bright each photograph is, measured on points that several of them see. The logarithm of a colour is taken as
 * that of the point plus that of the photograph's gain; medians, taken in turns, separate the two.
 *
 * @param {Frame[]} frames
 * @param {Structure} structure of these frames
 * @param {number} distance typical distance to the scene
 * @param {Object} settings the settings' `exposure`
 * @returns {number[][]} by frame, the factor on red, green and blue, with a geometric mean of 1; one that sees too
 *     few points has that of the most similar view; 1 for all where fewer than two see enough
 */
export function exposureGains(frames, structure, distance, settings) {
    const measured = coloursOfPoints(frames, structure, distance, settings);
    const counts = new Map();
    measured.forEach((own) => own.forEach(({ point }) => counts.set(point, (counts.get(point) ?? 0) + 1)));
    const counted = measured.map((own) => own.filter(({ point }) => counts.get(point) >= 2));
    const enough = counted.map((own) => own.length >= settings.min_points);
    if (enough.filter(Boolean).length < 2) {
        return frames.map(() => [1, 1, 1]);
    }
    const apart = viewDistances(structure.cameras, structure.cameras, distance);
    const measuredIn = enough.map((own, i) => (own ? i : sortedBy(apart[i]).find((view) => enough[view])));
    const byChannel = CHANNELS.map((channel) => gainsOf(counted, measuredIn, channel, settings));
    return frames.map((_, i) => byChannel.map((gains) => Math.exp(gains[i])));
}

/** The logarithms of the gains of one channel; each frame has the gain of the frame that it is measured in. */
function gainsOf(measured, measuredIn, channel, { alternations, settled }) {
    let gains = measured.map(() => 0);
    for (let round = 0; round < alternations; round++) {
        const byPoint = new Map();
        measured.forEach((own, frame) => {
            for (const { point, colour } of own) {
                byPoint.set(point, byPoint.get(point) ?? []);
                byPoint.get(point).push(colour[channel] - gains[frame]);
            }
        });
        const ofPoints = new Map([...byPoint].map(([point, values]) => [point, medianOf(values)]));
        const last = gains;
        const rest = ({ point, colour }) => colour[channel] - ofPoints.get(point);
        const found = measuredIn.map((frame) => medianOf(measured[frame].map(rest)));
        const mean = found.reduce((sum, gain) => sum + gain, 0) / found.length;
        gains = found.map((gain) => gain - mean);
        if (Math.max(...gains.map((gain, i) => Math.abs(gain - last[i]))) < settled) {
            break;
        }
    }
    return gains;
}

/** For each frame the logarithms of the colours of points that it is taken to see. */
function coloursOfPoints(frames, { cameras, points, observations }, distance, settings) {
    const wanted = enoughForEachView(observations, cameras.length, settings.enough_points);
    const seenBy = cameras.map(() => []);
    observations.frame.forEach((view, i) => wanted[observations.point[i]] && seenBy[view].push(observations.point[i]));
    const apart = viewDistances(cameras, cameras, distance);
    // Drawn at random, since a point tells nothing if only one photograph draws it.
    const random = new Generator(0);
    return frames.map((frame, i) => {
        const similar = sortedBy(apart[i]).slice(0, settings.neighbours);
        const visible = [...new Set(similar.flatMap((view) => seenBy[view]))].sort((a, b) => a - b);
        const drawn = [...random.permutation(visible.length).subarray(0, settings.most_points)];
        return drawn.flatMap((place) => {
            const point = visible[place];
            const colour = colourAt(frame, cameras[i], points.subarray(3 * point, 3 * point + 3), settings);
            return colour ? [{ point, colour: colour.map(Math.log) }] : [];
        });
    });
}

/** The blurred colour where a point falls in a photograph; null where the photograph does not see it well. */
function colourAt(frame, camera, point, { darkest, brightest, smoothing, blur_radius: inner }) {
    const place = projected(camera, ...point);
    if (!isInImage(camera, place)) {
        return null;
    }
    const [column, row] = place.map(Math.trunc);
    const isTransparent = frame.hasAlpha && frame.rgba[4 * (row * camera.width + column) + 3] < 255;
    if (isTransparent || (frame.mask && isNearMasked(frame.mask, camera, column, row, inner))) {
        return null;
    }
    const colour = blurred(frame.rgba, camera, column, row, smoothing);
    return colour.every((level) => level >= darkest && level <= brightest) ? colour : null;
}

/** Whether something is masked in the square around a pixel: blurred colours there are mixed with what is left out. */
function isNearMasked(mask, { width, height }, column, row, reach) {
    for (let y = Math.max(row - reach, 0); y <= Math.min(row + reach, height - 1); y++) {
        for (let x = Math.max(column - reach, 0); x <= Math.min(column + reach, width - 1); x++) {
            if (!mask[y * width + x]) {
                return true;
            }
        }
    }
    return false;
}

/** A pixel of the photograph blurred by a Gaussian, mirrored at its border, in whole levels as OpenCV's. */
function blurred(rgba, { width, height }, column, row, sigma) {
    const radius = (roundedToEven(6 * sigma + 1) | 1) >> 1;
    const sums = [0, 0, 0];
    let total = 0;
    for (let y = -radius; y <= radius; y++) {
        for (let x = -radius; x <= radius; x++) {
            const weight = Math.exp(-(x * x + y * y) / (2 * sigma * sigma));
            const at = 4 * (mirrored(row + y, height) * width + mirrored(column + x, width));
            total += weight;
            CHANNELS.forEach((channel) => (sums[channel] += weight * rgba[at + channel]));
        }
    }
    return sums.map((sum) => Math.round(sum / total));
}

/**
 * Whether photographs with similar views differ in exposure or white balance so much that one scene cannot look like
 * all of them.
 *
 * @param {import("../capture/camera.js").Camera[]} cameras
 * @param {number[][]} gains of each
 * @param {number} distance typical distance to the scene
 * @param {Object} settings the settings' `exposure`
 * @returns {boolean}
 */
export function needsCompensation(cameras, gains, distance, { neighbours, min_variation: least, predictable }) {
    const apart = viewDistances(cameras, cameras, distance);
    const exposures = gains.map((gain) => gain.map(Math.log));
    let [variation, surprise] = [0, 0];
    exposures.forEach((own, i) => {
        const similar = sortedBy(apart[i]).filter((view) => view !== i).slice(0, neighbours);
        own.forEach((exposure, channel) => {
            const mean = similar.reduce((sum, view) => sum + exposures[view][channel], 0) / similar.length;
            variation += Math.abs(exposure) / (3 * gains.length);
            surprise += Math.abs(exposure - mean) / (3 * gains.length);
        });
    });
    return variation >= least && surprise > predictable * variation;
}

/**
 * The photographs as they would have been taken at the mean exposure. Those with alpha stay as they are: they were cut
 * out and laid on a background, which has no exposure. White that a sensor cuts off, or that an object was laid on,
 * stays white: nobody knows how bright it was.
 *
 * @param {Frame[]} frames
 * @param {number[][]} gains of each
 * @param {{brightest: number}} settings `prior.exposure`
 * @returns {Frame[]}
 */
export function compensated(frames, gains, { brightest }) {
    return frames.map((frame, i) => {
        return frame.hasAlpha ? frame : { ...frame, rgba: withoutGain(frame.rgba, gains[i], brightest) };
    });
}

/** Colours at the mean exposure; from `brightest` to white they change less and less. */
function withoutGain(rgba, gain, brightest) {
    // A clamped array rounds and cuts off by itself.
    const found = rgba.slice();
    for (let pixel = 0; pixel < rgba.length; pixel += 4) {
        const least = Math.min(rgba[pixel], rgba[pixel + 1], rgba[pixel + 2]);
        const kept = Math.max(0, (least - brightest) / (255 - brightest));
        for (let channel = 0; channel < 3; channel++) {
            const level = rgba[pixel + channel];
            const changed = level / gain[channel];
            found[pixel + channel] = changed + kept * (level - changed);
        }
    }
    return found;
}
