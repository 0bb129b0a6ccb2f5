/**
 * Warnings about what was left out of a capture as its frames were loaded; the twin of `capture/left_out.py`.
 *
 * @module
 */

import { readDepth } from "./depth_map.js";
import { readMask } from "./masks.js";

/**
 * @typedef {import("./listing.js").FrameSource} FrameSource
 * @typedef {import("./photograph.js").Frame} Frame
 */

/**
 * A warning that counts the photographs that cannot be decoded.
 *
 * @param {Map<string, Error>} damaged errors by frame name
 * @param {number} of number of frames
 * @returns {string[]} one, or none
 */
export function damagedWarning(damaged, of) {
    if (!damaged.size) {
        return [];
    }
    const [first] = [...damaged.keys()].sort();
    const found = `${damaged.size} of ${of} photographs cannot be decoded, the first ${first}`;
    const reason = damaged.get(first).message;
    return [`${found}: these frames are left out (${reason}); if they are damaged, copy them again`];
}

/**
 * A warning that counts the frames whose masks exclude every pixel.
 *
 * @param {Frame[]} loaded
 * @param {Frame[]} usable
 * @returns {string[]} one, or none
 */
export function maskedOutWarning(loaded, usable) {
    const leftOut = loaded.filter((frame) => !usable.includes(frame)).map(({ name }) => name);
    const found = `the masks of ${leftOut.length} of ${loaded.length} frames leave no pixel, the first ${leftOut[0]}`;
    return leftOut.length ? [`${found}: these frames are left out; masks are white where pixels are to be used`] : [];
}

/**
 * Warnings that count the depth maps that were left out: those not readable, and those of another shape.
 *
 * @param {FrameSource[]} lacking the frames whose depth was left out
 * @returns {Promise<string[]>}
 */
export function depthWarnings(lacking) {
    return warningsOf("depth maps", "they are left out", lacking, ({ depth }) => readDepth(depth));
}

/**
 * Warnings that count the masks that were found and cannot be used: those not readable, and those of another shape.
 *
 * @param {FrameSource[]} lacking the frames whose mask was left out
 * @returns {Promise<string[]>}
 */
export function maskWarnings(lacking) {
    return warningsOf("masks", "the frames are used whole", lacking, ({ mask }) => readMask(mask));
}

async function warningsOf(kind, then, lacking, read) {
    const [unreadable, misshapen] = [[], []];
    for (const source of lacking) {
        const { name } = source;
        const reason = await read(source).then(() => null, ({ message }) => message);
        (reason === null ? misshapen : unreadable).push({ name, reason });
    }
    const warnings = [];
    if (unreadable.length) {
        const [{ name, reason }] = unreadable;
        const found = `the ${kind} of ${unreadable.length} frames cannot be used, the first of ${name}`;
        warnings.push(`${found}: ${then} (${reason})`);
    }
    if (misshapen.length) {
        const found = `the ${kind} of ${misshapen.length} frames have not the shape of their photographs`;
        warnings.push(`${found}, the first of ${misshapen[0].name}: ${then}`);
    }
    return warnings;
}
