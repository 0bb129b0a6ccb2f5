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
    const prior = options.prior === "dense" ? await densePrior(capture, options, settings, gpu, listener) : { capture };
    await listener.onStage("placing splats", 1);
    const points = prior.points ?? startingPoints(prior.capture, options.gaussians, options.seed, settings);
    return { capture: prior.capture, points };
}

/**
 * The capture with the prior's poses, also where its cloud is of no use: warnings have told of them.
 *
 * @returns {Promise<{capture: Capture, points?: Cloud}>}
 */
async function densePrior(given, { gaussians: most, refines }, settings, gpu, { onStage, onWarning }) {
    const { capture, dense } = await buildPrior(given, { most, refines }, settings, gpu, { onStage, onWarning });
    if (dense instanceof NoRoom) {
        const instead = capture.cloud ? "the capture's own points" : "points where the photographs agree";
        onWarning(`Depth is not computed: ${dense.message}. Training starts from ${instead}.`);
        return { capture };
    }
    const found = dense.cloud.positions.length / 3;
    if (found < settings.run.min_points) {
        onWarning(`Too few points were found (${found}): training starts from other points.`);
        return { capture };
    }
    return { capture, points: dense.cloud };
}
