/**
 * What training starts from; the twin of `prepare` in `training/preparation.py`.
 *
 * @module
 */

import { buildPrior } from "../prior/prior.js";
import { NoRoom } from "../prior/stereo.js";
import { startingPoints } from "../seeding/points.js";

/**
 * @typedef {import("../capture/listing.js").Cloud} Cloud
 * @typedef {import("../capture/open.js").Capture} Capture
 *
 * @typedef {Object} Gpu
 * @property {import("../prior/stereo.js").Stereo} stereo
 * @property {import("../prior/features/finder.js").FeatureFinder} finder
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
 * @param {Gpu} gpu
 * @param {Listener} listener
 * @returns {Promise<{capture: Capture, points: Cloud}>} the capture as it is trained on, and its points
 * @throws {Error} there is nothing to start from
 */
export async function prepared(capture, options, settings, gpu, listener) {
    const prior = options.prior === "dense" ? await densePrior(capture, options, settings, gpu, listener) : null;
    await listener.onStage("placing splats", 1);
    return prior ?? { capture, points: startingPoints(capture, options.gaussians, options.seed, settings) };
}

/** @returns {Promise<{capture: Capture, points: Cloud} | null>} */
async function densePrior(capture, { gaussians: most, refines }, settings, gpu, { onStage, onWarning }) {
    try {
        const prior = await buildPrior(capture, { most, refines }, settings, gpu, { onStage, onWarning });
        const found = prior.cloud.positions.length / 3;
        if (found >= settings.run.min_points) {
            return { capture: prior.capture, points: prior.cloud };
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
