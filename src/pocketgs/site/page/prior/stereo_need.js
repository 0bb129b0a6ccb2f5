/**
 * The memory that depth takes; see `StereoNeed` in `prior/depth/stereo.py`.
 *
 * @module
 */

/**
 * @typedef {import("../../gpu/description.js").Description} Description
 * @typedef {import("../numbers/resizing.js").Size} Size
 *
 * @typedef {Object} StereoNeed
 * @property {number} bands in which the sums of a sweep are made, so that a buffer holds them
 * @property {Object<string, number>} sweeping bytes of the GPU's buffers while keyframes are swept
 * @property {Object<string, number>} comparing the same while their depth maps are compared
 * @property {number} mapBytes of all depth maps
 */

/** Of a pixel's depth and margin. */
const MAP_BYTES = 8;

/**
 * @param {{sweep: Description, comparison: Description}} passes
 * @param {Size[]} frames at the size of a sweep
 * @param {number} keyframes their number
 * @param {number} largestBuffer bytes that the GPU allows
 * @param {Object<string, number>} settings the settings' `sweep`
 * @returns {StereoNeed}
 */
export function stereoNeed({ sweep, comparison }, frames, keyframes, largestBuffer, settings) {
    const { most_hypotheses: hypotheses, most_bands: most, source_views: sources, paths } = settings;
    const [across, down] = ["width", "height"].map((side) => frames.reduce((a, b) => Math.max(a, b[side]), 0));
    const { width, height } = frames.reduce((a, b) => (a.width * a.height < b.width * b.height ? b : a));
    const numbers = { width, height, image_width: across, image_height: down };
    const inBands = (bands) => {
        return sizesIn(sweep, { ...numbers, images: 1 + sources, hypotheses, paths, bands });
    };
    let bands = 1;
    while (bands < most && Math.max(...Object.values(inBands(bands))) > largestBuffer) {
        bands++;
    }
    const comparing = sizesIn(comparison, { ...numbers, views: keyframes });
    return { bands, sweeping: inBands(bands), comparing, mapBytes: MAP_BYTES * width * height * keyframes };
}

/** Bytes of the buffers that a description's passes need. */
function sizesIn(description, given) {
    return description.sizes(description.symbols(given));
}
