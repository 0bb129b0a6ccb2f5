/**
 * A software-rendered image of points: soft ellipses, near ones over far ones.
 *
 * @module
 */

import { ALPHA_MAX } from "../constants.js";
import { Ellipses, WORDS } from "./ellipses.js";

/**
 * @typedef {import("../scene/camera.js").Camera} Camera
 * @typedef {import("./points.js").Points} Points
 */

/** Transmittance below which a pixel takes no more. */
const CLEAR_ENOUGH = 1 / 255;

/** exp(-½ q) for q in steps of 1/STEPS, up to where even an opaque ellipse ends. */
const STEPS = 64;
const FALLOFF = Float32Array.from({ length: 12 * STEPS }, (_, i) => Math.exp((-0.5 * (i + 0.5)) / STEPS));

/** Pixels that are drawn between two pauses, and how many of them an ellipse counts for besides its own. */
const SLICE = 250_000;
const PIXELS_PER_ELLIPSE = 16;

/** Pixels. */
export class PointImage {
    #ellipses = new Ellipses();
    /** (pixels, 3): RGB so far, up to 255. */
    #sums;
    /** (pixels,): transmittance. */
    #clear;

    /**
     * @param {number} width
     * @param {number} height
     */
    constructor(width, height) {
        this.data = new ImageData(width, height);
        this.#sums = new Float32Array(3 * width * height);
        this.#clear = new Float32Array(width * height);
    }

    /**
     * Clear and draw. Pauses often, so that others can go on meanwhile.
     *
     * @param {Points} points
     * @param {Camera} camera whose image has this image's size
     * @param {[number, number, number]} background RGB
     * @yields {undefined} after a few milliseconds of work each
     */
    *draw(points, camera, background) {
        this.#sums.fill(0);
        this.#clear.fill(1);
        this.#ellipses.find(points, camera);
        yield;
        let drawn = 0;
        for (const ellipse of this.#ellipses.nearestFirst()) {
            drawn += PIXELS_PER_ELLIPSE + this.#blend(WORDS * ellipse, points.colours[this.#ellipses.indices[ellipse]]);
            if (drawn > SLICE) {
                drawn = 0;
                yield;
            }
        }
        this.#finish(background);
    }

    /** Composite an ellipse behind what is there (3DGS, equation 3). Returns how many pixels it covers. */
    #blend(first, colour) {
        const { width, height } = this.data;
        const { numbers } = this.#ellipses;
        const [x, y, a, b] = [numbers[first], numbers[first + 1], numbers[first + 2], numbers[first + 3]];
        const [c, opacity] = [numbers[first + 4], numbers[first + 5]];
        const [edge, reach] = [numbers[first + 6], numbers[first + 7]];
        const top = Math.max(Math.ceil(y - reach - 0.5), 0);
        const bottom = Math.min(Math.floor(y + reach - 0.5), height - 1);
        let covered = 0;
        for (let row = top; row <= bottom; row++) {
            // a dx² + 2 b dx dy + c dy² is the edge's at both ends of the row.
            const dy = row + 0.5 - y;
            const half = Math.sqrt(Math.max(b * b * dy * dy - a * (c * dy * dy - edge), 0)) / a;
            const middle = x - (b * dy) / a - 0.5;
            const left = Math.max(Math.ceil(middle - half), 0);
            const right = Math.min(Math.floor(middle + half), width - 1);
            if (left <= right) {
                covered += right - left + 1;
                this.#blendRow(row * width + left, row * width + right, left + 0.5 - x, dy, a, b, c, opacity, colour);
            }
        }
        return covered;
    }

    /** From the first pixel, at (dx, dy) from the ellipse's centre, to the last. */
    #blendRow(first, last, dx, dy, a, b, c, opacity, colour) {
        const [sums, clear] = [this.#sums, this.#clear];
        const [red, green, blue] = [colour & 255, (colour >>> 8) & 255, colour >>> 16];
        for (let pixel = first; pixel <= last; pixel++, dx++) {
            const through = clear[pixel];
            if (through > CLEAR_ENOUGH) {
                const extent = Math.max(dx * (a * dx + 2 * b * dy) + c * dy * dy, 0);
                const weight = through * Math.min(opacity * FALLOFF[Math.floor(extent * STEPS)], ALPHA_MAX);
                sums[3 * pixel] += weight * red;
                sums[3 * pixel + 1] += weight * green;
                sums[3 * pixel + 2] += weight * blue;
                clear[pixel] = through - weight;
            }
        }
    }

    #finish(background) {
        const { data: bytes } = this.data;
        for (let pixel = 0; pixel < this.#clear.length; pixel++) {
            for (let channel = 0; channel < 3; channel++) {
                const behind = 255 * background[channel] * this.#clear[pixel];
                bytes[4 * pixel + channel] = this.#sums[3 * pixel + channel] + behind;
            }
            bytes[4 * pixel + 3] = 255;
        }
    }
}
