/**
 * Warnings about what was left out of a capture as its frames were loaded; the twin of `capture/left_out.py`.
 *
 * @module
 */

import { readDepth } from "./depth_map.js";

/**
 * @typedef {import("./listing.js").FrameSource} FrameSource
 * @typedef {import("./photograph.js").Frame} Frame
 */

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
export async function depthWarnings(lacking) {
    const [unreadable, misshapen] = [[], []];
    for (const { name, depth } of lacking) {
        const reason = await readDepth(depth).then(() => null, ({ message }) => message);
        (reason === null ? misshapen : unreadable).push({ name, reason });
    }
    const warnings = [];
    if (unreadable.length) {
        const [{ name, reason }] = unreadable;
        const found = `the depth maps of ${unreadable.length} frames cannot be used, the first of ${name}`;
        warnings.push(`${found}: they are left out (${reason})`);
    }
    if (misshapen.length) {
        const found = `the depth maps of ${misshapen.length} frames have not the shape of their photographs`;
        warnings.push(`${found}, the first of ${misshapen[0].name}: they are left out`);
    }
    return warnings;
}
