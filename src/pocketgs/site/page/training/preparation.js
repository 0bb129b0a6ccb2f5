/**
 * The points that training starts from; the twin of `prepare` in `training/preparation.py`.
 *
 * @module
 */

import { buildPrior, NoRoom } from "../prior/prior.js";
import { startingPoints } from "../seeding/points.js";

/**
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 *
 * @typedef {Object} Listener
 * @property {(text: string, share: number) => Promise<void>} onStage called before each piece of work; rejects to stop
 * @property {(text: string) => void} onWarning
 */

/**
 * The cloud of the prior, or if there is none the capture's own points, or random ones where the photographs agree.
 *
 * @param {import("../capture/open.js").Capture} capture
 * @param {import("./run.js").Options} options
 * @param {Object} settings
 * @param {import("../prior/stereo.js").Stereo} stereo
 * @param {Listener} listener
 * @returns {Promise<Cloud>}
 * @throws {Error} there is nothing to start from
 */
export async function preparedPoints(capture, options, settings, stereo, listener) {
    const cloud = options.prior === "dense" ? await denseCloud(capture, options, settings, stereo, listener) : null;
    await listener.onStage("placing splats", 1);
    return cloud ?? startingPoints(capture, options.gaussians, options.seed, settings);
}

/** @returns {Promise<Cloud | null>} */
async function denseCloud(capture, { gaussians }, settings, stereo, { onStage, onWarning }) {
    try {
        const { cloud } = await buildPrior(capture, gaussians, settings, stereo, { onStage });
        const found = cloud.positions.length / 3;
        if (found >= settings.run.min_points) {
            return cloud;
        }
        onWarning(`Too few points were found (${found}): training starts from other points.`);
    } catch (error) {
        if (!(error instanceof NoRoom)) {
            throw error;
        }
        const instead = capture.cloud ? "the capture's own points" : "points where the photographs agree";
        onWarning(`Depth is not computed: ${error.message}. Training starts from ${instead}.`);
    }
    return null;
}
