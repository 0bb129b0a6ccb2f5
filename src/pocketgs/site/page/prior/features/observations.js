/**
 * Observations of points in views; the twin of `prior/features/observations.py`.
 *
 * @module
 */

/**
 * @typedef {Object} Observations M of them
 * @property {Int32Array} frame (M,) index of the view
 * @property {Int32Array} point (M,) index of the point
 * @property {Float64Array} pixels (M, 2) positions
 */

/**
 * The observations with some indices; points keep their numbers.
 *
 * @param {Observations} observations
 * @param {ArrayLike<number>} indices
 * @returns {Observations}
 */
export function selected({ frame, point, pixels }, indices) {
    const chosen = {
        frame: new Int32Array(indices.length),
        point: new Int32Array(indices.length),
        pixels: new Float64Array(2 * indices.length),
    };
    for (let i = 0; i < indices.length; i++) {
        const from = indices[i];
        chosen.frame[i] = frame[from];
        chosen.point[i] = point[from];
        chosen.pixels[2 * i] = pixels[2 * from];
        chosen.pixels[2 * i + 1] = pixels[2 * from + 1];
    }
    return chosen;
}

/** The observations for whose indices a test holds. */
export const filtered = (observations, test) => selected(observations, indicesWhere(observations.frame.length, test));

/** The indices below a number for which a test holds. @type {(end: number, test: (i: number) => any) => number[]} */
export function indicesWhere(end, test) {
    const found = [];
    for (let i = 0; i < end; i++) {
        if (test(i)) {
            found.push(i);
        }
    }
    return found;
}

/** The observations with points renumbered from 0, in the same order. @type {(o: Observations) => Observations} */
export function renumbered(observations) {
    const places = new Map(Array.from(new Set(observations.point)).sort((a, b) => a - b).map((point, i) => [point, i]));
    return { ...observations, point: observations.point.map((point) => places.get(point)) };
}

/** One more than the largest number of a point. @type {(observations: Observations) => number} */
export const pointsOf = ({ point }) => point.reduce((most, number) => Math.max(most, number), -1) + 1;

/** How often each of some numbers occurs. @type {(numbers: ArrayLike<number>, length: number) => Int32Array} */
export function countsOf(numbers, length) {
    const counts = new Int32Array(length);
    for (let i = 0; i < numbers.length; i++) {
        counts[numbers[i]] += 1;
    }
    return counts;
}

/** Of observations sorted by point, where each point's begin. @type {(observations: Observations) => Int32Array} */
export function startsOf(observations) {
    const points = pointsOf(observations);
    const starts = new Int32Array(points + 1);
    countsOf(observations.point, points).forEach((count, i) => (starts[i + 1] = starts[i] + count));
    return starts;
}

/**
 * Which points are enough for every view to see a number of them if it can; those seen by most views come first.
 *
 * @param {Observations} observations
 * @param {number} views number of views
 * @param {number} most points per view that are enough
 * @returns {Uint8Array} by point, whether it is wanted
 */
export function enoughForEachView(observations, views, most) {
    const frames = Array.from({ length: pointsOf(observations) }, () => []);
    observations.point.forEach((point, i) => frames[point].push(observations.frame[i]));
    const order = frames.map((_, point) => point).sort((a, b) => frames[b].length - frames[a].length || a - b);
    const have = new Int32Array(views);
    const wanted = new Uint8Array(frames.length);
    for (const point of order) {
        if (frames[point].some((frame) => have[frame] < most)) {
            wanted[point] = 1;
            frames[point].forEach((frame) => (have[frame] += 1));
        }
    }
    return wanted;
}
