/**
 * Checks of scenes; the twin of `require_sound` in `formats/checks.py`.
 *
 * @module
 */

import { MEAN, OPACITY_LOGIT } from "../constants.js";

/**
 * Refuse NaN and infinity, which only broken files of quantising formats lead to.
 *
 * An infinite opacity logit is allowed: it means an opacity of exactly 0 or 1.
 *
 * @param {import("../scene/gaussian_columns.js").GaussianColumns} gaussians
 * @throws {Error} a Gaussian holds NaN or infinity
 */
export function requireSound({ count, shape, sh }) {
    const isBroken = new Uint8Array(count);
    markUnsound(isBroken, shape.subarray(MEAN * count, OPACITY_LOGIT * count));
    markUnsound(isBroken, sh);
    shape.subarray(OPACITY_LOGIT * count).forEach((logit, i) => (isBroken[i] |= Number.isNaN(logit) ? 1 : 0));
    const broken = isBroken.reduce((sum, each) => sum + each, 0);
    if (broken) {
        throw new Error(`${broken} of ${count} Gaussians hold NaN or infinity, expected finite numbers`);
    }
}

/** Mark the Gaussians of which a number of the columns is NaN or infinity. */
function markUnsound(isBroken, columns) {
    for (let i = 0; i < columns.length; i++) {
        if (!Number.isFinite(columns[i])) {
            isBroken[i % isBroken.length] = 1;
        }
    }
}
