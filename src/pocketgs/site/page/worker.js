/**
 * The worker in which everything is computed, so that the page stays responsive: reading, seeding, training.
 *
 * @module
 */

import { FileTree, StoredFile } from "./archive/tree.js";
import { filesInZip } from "./archive/zip.js";
import { loadCapture, readListing } from "./capture/open.js";
import { plyOf } from "./formats/ply_writer.js";
import { KeptRun } from "./storage/kept_run.js";
import { firstView } from "./training/first_view.js";
import { Run } from "./training/run.js";
import { Trainer } from "./training/trainer.js";

/**
 * @typedef {Object} Picked what the user chose: one archive, or the files of a folder
 * @property {string} name without suffix
 * @property {File | null} archive
 * @property {{path: string, file: File}[]} files
 */

const MS_UNTIL_LOSS_IS_TOLD = 500;

const [settings, passes] = await Promise.all(["settings.json", "passes.json"].map(fetched));
/** @type {Run | null} */
let run = null;
/** Until the last run's pictures are drawn. */
let serving = Promise.resolve();

// Shaders are compiled while the user chooses a capture.
let opening = open();
const kept = await KeptRun.open();

self.addEventListener("message", async ({ data }) => {
    if (data.type === "train") {
        await train(data.picked, data.options).catch(failed);
    } else if (data.type === "go on") {
        await goOn().catch(failed);
    } else if (data.type === "look") {
        run?.look(data.camera);
    } else {
        run?.[data.type]();
    }
});
tell("settings", { run: settings.run });
tellOfKept();

/** @type {(picked: Picked, options: {most: number, iterations: number, gaussians: number}) => Promise<void>} */
async function train(picked, { most, ...chosen }) {
    await endLast();
    const capture = await opened(picked, most);
    const options = { seed: settings.run.seed, ...chosen };
    // A browser that has no room for the run trains all the same.
    const isKept = (await kept?.begin(picked.name, capture, options).then(() => true, () => false)) ?? false;
    await perform(capture, options, isKept, (run) => run.go());
}

/** Go on with the run of an earlier visit. */
async function goOn() {
    await endLast();
    const { capture, options, checkpoint } = await kept.read();
    await perform(capture, options, true, (run) => run.goOn(checkpoint));
}

async function endLast() {
    run?.close();
    run = null;
    await serving;
}

/**
 * Train, and then draw the scene until the next run.
 *
 * @param {import("./capture/open.js").Capture} capture
 * @param {import("./training/run.js").Options} options
 * @param {boolean} isKept whether there is room to keep it
 * @param {(run: Run) => Promise<import("../page/scene/gaussian_columns.js").GaussianColumns>} work
 */
async function perform(capture, options, isKept, work) {
    tell("stage", { text: "compiling shaders" });
    const trainer = await opening;
    tell("stage", { text: "placing splats" });
    tell("first", firstView(capture, settings.volume));
    run = new Run(trainer, capture, settings, options, {
        onProgress: (progress) => tell("progress", progress),
        onPicture: (picture) => tell("picture", { picture }),
        onCheckpoint: async (checkpoint) => {
            isKept &&= await kept.keep(checkpoint).then(() => true, () => false);
            await tellOfKept();
        },
    });
    const scene = await Promise.race([lossOf(trainer), work(run).catch(thrownLater)]);
    tell("done", { ply: plyOf(scene) });
    serving = run.serve().catch((error) => fault(error.message));
}

async function failed(error) {
    fault(error.message);
    await tellOfKept();
}

async function tellOfKept() {
    tell("kept", { found: (await kept?.summary()) ?? null });
}

/** Open the GPU, and once it is lost, open it anew. */
function open() {
    const trainer = Trainer.open(passes, settings, (text) => tell("complaint", { text }));
    trainer.then(
        ({ lost }) => {
            tell("ready");
            lost.then(() => (opening = open()));
        },
        (error) => fault(error.message),
    );
    return trainer;
}

/** @returns {Promise<never>} rejects when the GPU is lost */
async function lossOf({ lost }) {
    const { message } = await lost;
    const reason = message || "the browser gives no reason";
    throw new Error(`The GPU was lost: ${reason}. Go on, or train again with smaller photographs.`);
}

/** What a lost GPU makes fail fails first: let its loss be told before. */
async function thrownLater(error) {
    await new Promise((resolve) => setTimeout(resolve, MS_UNTIL_LOSS_IS_TOLD));
    throw error;
}

async function opened({ archive, files }, most) {
    tell("stage", { text: "opening the capture" });
    const stored = archive
        ? await filesInZip(archive, archive.name)
        : files.map(({ path, file }) => StoredFile.ofDisk(file, path));
    const listing = await readListing(new FileTree(stored), settings.capture);
    const capture = await loadCapture(listing, most, settings, (done, of) => {
        tell("stage", { text: `photograph ${done} of ${of}`, share: done / of });
    });
    tell("capture", { warnings: capture.warnings });
    return capture;
}

async function fetched(name) {
    const response = await fetch(new URL(name, import.meta.url));
    if (!response.ok) {
        throw new Error(`${name}: the server answers ${response.status}`);
    }
    return response.json();
}

function fault(text) {
    tell("fault", { text });
}

function tell(type, content = {}) {
    self.postMessage({ type, ...content });
}
