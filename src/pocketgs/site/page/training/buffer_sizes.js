/**
 * Sizes of the GPU's buffers for a run; see `splat/webgpu/memory.py`.
 *
 * @module
 */

/**
 * @typedef {import("../../gpu/description.js").Description} Description
 *
 * @typedef {{width: number, height: number}} Size
 *
 * @typedef {Object} Extent what the sizes of buffers follow from
 * @property {number} gaussians
 * @property {number} coefficients of spherical harmonics per channel
 * @property {number} intersections of tiles' lists, that there is to be room for
 * @property {number} photographs
 * @property {number} photographPixels that lie on the GPU
 */

/**
 * The numbers that the passes of one image follow from.
 *
 * @param {Description} description
 * @param {Extent} extent
 * @param {Size} size of the image
 * @param {boolean} structural whether its loss has a structural part
 * @returns {Object<string, number>}
 */
export function symbolsOf(description, extent, { width, height }, structural) {
    const { gaussians, coefficients, intersections, photographs, photographPixels } = extent;
    return description.symbols({
        gaussians,
        capacity: gaussians,
        coefficients,
        intersections,
        photographs,
        photograph_pixels: photographPixels,
        replay_depth: 0,
        width,
        height,
        structural: Number(structural),
        regularised: 0,
        collecting: 0,
    });
}

/**
 * Bytes of every buffer, enough for each of the images.
 *
 * @param {Description} description
 * @param {Extent} extent
 * @param {Size[]} photographs to train on
 * @param {Size[]} pictures that are only drawn
 * @returns {Object<string, number>}
 */
export function largestSizes(description, extent, photographs, pictures = []) {
    const largest = {};
    for (const [sizes, sequences] of [[photographs, Object.keys(description.sequences)], [pictures, ["render"]]]) {
        const buffers = description.buffersOf(sequences);
        for (const size of new Map(sizes.map((one) => [`${one.width}x${one.height}`, one])).values()) {
            const needed = description.sizes(symbolsOf(description, extent, size, true), buffers);
            Object.entries(needed).forEach(([name, bytes]) => (largest[name] = Math.max(bytes, largest[name] ?? 0)));
        }
    }
    return largest;
}

/** Of pictures where there is no room for whole ones. @type {(size: Size) => Size} */
export const halved = ({ width, height }) => ({ width: Math.ceil(width / 2), height: Math.ceil(height / 2) });

/** Bytes in all. @type {(sizes: Object<string, number>) => number} */
export const totalOf = (sizes) => Object.values(sizes).reduce((sum, bytes) => sum + bytes, 0);

/**
 * Intersections that a run's tiles' lists may come to hold: large Gaussians tile the image.
 *
 * @param {number} gaussians
 * @param {Size[]} sizes of the images
 * @param {number} largestBuffer bytes that the device allows
 * @param {Object<string, number>} engine the settings' `engine`
 * @returns {number}
 */
export function expectedIntersections(gaussians, sizes, largestBuffer, engine) {
    const pixels = sizes.reduce((most, { width, height }) => Math.max(most, width * height), 0);
    const expected = Math.floor(engine.expected_per_gaussian * gaussians + engine.expected_per_pixel * pixels);
    const wanted = Math.max(expected, engine.intersections_per_gaussian * gaussians);
    const most = Math.floor(largestBuffer / engine.intersection_bytes);
    return Math.max(engine.min_intersections, Math.min(wanted, most));
}
