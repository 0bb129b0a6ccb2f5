/**
 * What a run may take of the device's memory, before any of it is taken, and what is reduced so that it fits.
 *
 * @module
 */

import { needOf } from "./need.js";

/**
 * @typedef {import("../../gpu/description.js").Description} Description
 * @typedef {import("../capture/outline.js").Outline} Outline
 * @typedef {import("./buffer_sizes.js").Size} Size
 *
 * @typedef {Object} Wish
 * @property {number} most pixels of the longer side
 * @property {number} gaussians
 * @property {number} bytes that the page may take
 * @property {Size} screen the largest picture that may be asked for
 * @property {"dense" | "none"} prior whether depth is computed first
 *
 * @typedef {Object} Device
 * @property {Description} description of the passes of training
 * @property {{sweep: Description, comparison: Description}} depth those of depth
 * @property {number} largestBuffer bytes that it allows
 *
 * @typedef {Object} Plan
 * @property {number} most pixels of the longer side, as wished or fewer
 * @property {number} gaussians likewise
 * @property {"dense" | "none"} prior "none" where there is no room for depth
 * @property {number} bytes that the page takes at most
 * @property {number} bufferBytes those of the GPU's buffers among them, at most
 * @property {number} mostBufferBytes that there is room for
 * @property {string} text for the user
 */

/**
 * Plan a run: with the photographs as large as wished if they fit, else smaller, then with fewer Gaussians, and at last
 * without depth.
 *
 * @param {Outline} outline
 * @param {Wish} wish
 * @param {Device} device
 * @param {Object} settings
 * @returns {Plan}
 * @throws {Error} it does not fit at the least size, with the fewest Gaussians
 */
export function planRun(outline, wish, device, settings) {
    const longest = outline.frames.reduce((most, { width, height }) => Math.max(most, width, height), 0);
    const wished = { ...wish, most: Math.min(wish.most, longest) };
    const need = (chosen) => needOf(outline, chosen, device, settings);
    const fits = (chosen) => {
        const { bytes, largest } = need(chosen);
        return bytes <= wish.bytes && largest <= device.largestBuffer;
    };
    const { least_side, least_gaussians } = settings.plan;
    const least = { most: Math.min(least_side, wished.most), gaussians: Math.min(least_gaussians, wish.gaussians) };
    const withoutDepth = { ...wished, prior: "none" };
    const chosen = reduced(wished, least, fits) ?? reduced(withoutDepth, least, fits);
    if (chosen === null) {
        throw refusal(outline, { ...withoutDepth, ...least }, need({ ...withoutDepth, ...least }));
    }
    const { bytes, bufferBytes, otherBytes } = need(chosen);
    return {
        most: chosen.most < wished.most ? chosen.most : wish.most,
        gaussians: chosen.gaussians,
        prior: chosen.prior,
        bytes,
        bufferBytes,
        mostBufferBytes: wish.bytes - otherBytes,
        text: textOf(outline, wished, need(wished), chosen, { bytes, bufferBytes }),
    };
}

/** What is wished, with photographs and then the number of Gaussians reduced until it fits; null if it never does. */
function reduced(wished, least, fits) {
    const side = largestThat((most) => fits({ ...wished, most }), least.most, wished.most);
    const resized = { ...wished, most: side ?? least.most };
    const fitting = (gaussians) => fits({ ...resized, gaussians });
    const gaussians = largestThat(fitting, least.gaussians, wished.gaussians);
    return gaussians === null ? null : { ...resized, gaussians };
}

function refusal(outline, least, { bytes }) {
    const isLarge = bytes > least.bytes;
    const why = isLarge ? `more than ${megabytes(least.bytes)} MB` : "in buffers that the GPU does not allow";
    const found = `${asked(outline, least)} would take ${megabytes(bytes)} MB, ${why}`;
    return new Error(`${found}: expected fewer or smaller photographs`);
}

/** The largest whole number for which something holds that holds for all smaller ones too, or null. */
function largestThat(holds, least, most) {
    if (holds(most)) {
        return most;
    }
    let [low, high] = [least, most];
    if (!holds(low)) {
        return null;
    }
    while (high - low > 1) {
        const middle = Math.floor((low + high) / 2);
        [low, high] = holds(middle) ? [middle, high] : [low, middle];
    }
    return low;
}

function textOf(outline, wished, first, chosen, { bytes, bufferBytes }) {
    const takes = `Takes about ${megabytes(bytes)} MB, ${megabytes(bufferBytes)} MB of it in buffers of the GPU.`;
    const reduced = [
        ...(chosen.most < wished.most ? [`photographs to ${chosen.most} pixels`] : []),
        ...(chosen.gaussians < wished.gaussians ? [`splats to ${counted(chosen.gaussians)}`] : []),
    ];
    const changes = [
        ...(chosen.prior === wished.prior ? [] : ["Left out depth"]),
        ...(reduced.length ? [`Reduced ${reduced.join(" and ")}`] : []),
    ];
    if (!changes.length) {
        return takes;
    }
    const why = first.bytes > wished.bytes ? `${megabytes(first.bytes)} MB` : "a buffer larger than the GPU's";
    return `${takes} ${changes.join(". ")}, because ${asked(outline, wished)} would take ${why}.`;
}

const asked = ({ frames }, { most, gaussians, prior }) => {
    const sizes = `${frames.length} photographs of ${most} pixels and ${counted(gaussians)} splats`;
    return prior === "dense" ? `${sizes}, with depth,` : sizes;
};

const megabytes = (bytes) => counted(Math.ceil(bytes / 1e6));

const counted = (number) => number.toLocaleString("en");
