/**
 * The worker in which everything is computed, so that the page stays responsive: reading, seeding, training.
 *
 * @module
 */

import { onDevice } from "../page/drawing/opening.js";
import { FileTree, StoredFile } from "./archive/tree.js";
import { filesInZip } from "./archive/zip.js";
import { withoutDepth } from "./capture/depth_map.js";
import { loadCapture, readListing } from "./capture/open.js";
import { outlineOf } from "./capture/outline.js";
import { pgsOf } from "./formats/pgs_writer.js";
import { plyOf } from "./formats/ply_writer.js";
import { spzOf } from "./formats/spz_writer.js";
import { GpuLoss } from "./gpu_loss.js";
import { GpuOpening } from "./gpu_opening.js";
import { FeatureFinder } from "./prior/features/finder.js";
import { Stereo } from "./prior/stereo.js";
import { NeighbourSearch } from "./seeding/neighbour_search.js";
import { KeptRun, sceneOf } from "./storage/kept_run.js";
import { firstView } from "./training/first_view.js";
import { planRun } from "./training/plan.js";
import { prepared } from "./training/preparation.js";
import { Run } from "./training/run.js";
import { Trainer } from "./training/trainer.js";

/**
 * @typedef {Object} Picked what the user chose: one archive, or the files of a folder
 * @property {string} name without suffix
 * @property {File | null} archive
 * @property {{path: string, file: File}[]} files
 */

const LOST_WHILE_KEPT = "Go on, or train again with smaller photographs.";
const LOST_UNKEPT = "Train again, with smaller photographs.";
const LOST_AT_REST = "The scene can be saved, but not turned.";
const KEPT_ELSEWHERE = "Another tab of this page keeps a run: close it.";
const NOT_KEPT = "This run cannot be kept in the browser's storage: stop and save it before you leave the page.";

const DATA = ["settings.json", "passes.json", "depth_passes.json", "features_passes.json", "seeding_passes.json"];
const [settings, passes, depthPasses, featuresPasses, seedingPasses] = await Promise.all(DATA.map(fetched));
/** The name of the site's folder, which follows from all that it consists of. */
const version = new URL("..", import.meta.url).pathname.split("/").at(-2);
/** @type {Run | null} */
let run = null;
/** Ends what comes before training; null from then on. @type {AbortController | null} */
let cancelling = null;
/** Until the last run's pictures are drawn. */
let serving = Promise.resolve();

// Shaders are compiled while the user chooses a capture.
const opening = new GpuOpening(openGpu, () => tell("ready"), complain);
/** Null where the browser keeps nothing, and while another page keeps a run. @type {KeptRun | null} */
let kept = null;
/** What `kept` was when the run began: only then has the page asked whether an earlier one may be lost. */
let keeper = kept;
await openKept();

self.addEventListener("message", async ({ data }) => {
    if (data.type === "train") {
        await train(data.picked, data.options).catch(failed);
    } else if (data.type === "go on") {
        await goOn().catch(failed);
    } else if (data.type === "give") {
        await give().catch(failed);
    } else if (data.type === "cancel") {
        cancelling?.abort();
    } else if (data.type === "look") {
        run?.look(data.camera);
    } else {
        run?.[data.type]();
    }
});
tell("settings", { run: settings.run, plan: settings.plan });

/**
 * @typedef {Object} Own what a plan leaves as it is
 * @property {number} iterations
 * @property {boolean} refines whether the prior finds features, and by them refines poses
 *
 * @type {(picked: Picked, options: import("./training/plan.js").Wish & Own) => Promise<void>}
 */
async function train(picked, own) {
    await endLast();
    const { gpu, capture, points, options } = await readied(picked, own);
    const work = (run) => run.go(points, gpu.search, cancelling.signal);
    await perform(picked.name, capture, options, gpu, false, work);
}

/** What a run needs: the GPU, its capture with refined poses, the points that it starts from, its options. */
async function readied(picked, { iterations, refines, ...wish }) {
    const [given, { gaussians, prior, mostBufferBytes }] = await opened(picked, wish);
    const options = { seed: settings.run.seed, iterations, gaussians, prior, refines, mostBufferBytes };
    const gpu = await compiled();
    const { capture, points } = await gpu.loss.unless(preparedOn(gpu, given, options), () => LOST_UNKEPT);
    capture.train.forEach((frame) => (frame.depth = null));
    return { gpu, capture, points, options };
}

/** Go on with the run of an earlier visit. */
async function goOn() {
    await endLast();
    const { name, capture, options, checkpoint } = await keeper.read();
    await perform(name, capture, options, await compiled(), true, (run) => run.goOn(checkpoint, cancelling.signal));
}

/** Give the scene of an earlier visit's run as it is kept. */
async function give() {
    await endLast();
    const { checkpoint } = await keeper.read();
    tell("done", { scene: await filesOf(sceneOf(checkpoint)), isKept: true });
}

async function endLast() {
    cancelling = new AbortController();
    keeper = kept;
    run?.close();
    run = null;
    await serving;
}

async function compiled() {
    await stage("compiling shaders");
    return opening.get();
}

function preparedOn({ trainer, stereo, finder, loss }, capture, options) {
    trainer.release();
    stereo.mostBytes = finder.mostBytes = options.mostBufferBytes;
    return prepared(capture, options, settings, { stereo, finder }, {
        onStage: (text, share) => {
            loss.throwIfLost();
            return stage(text, share, stereo.bytes + finder.bytes);
        },
        onWarning: (text) => {
            loss.throwIfLost(); // what fails for want of the GPU only seems to lack room
            tell("complaint", { text });
        },
    });
}

/**
 * Train, and then draw the scene until the next run.
 *
 * @param {string} name
 * @param {import("./capture/open.js").Capture} capture
 * @param {import("./training/run.js").Options} options
 * @param {Gpu} gpu
 * @param {boolean} isKept whether the run is kept already
 * @param {(run: Run) => Promise<import("../page/scene/gaussian_columns.js").GaussianColumns>} work
 */
async function perform(name, capture, options, gpu, isKept, work) {
    let canGoOn = isKept;
    gpu.trainer.mostBytes = options.mostBufferBytes ?? Infinity;
    tell("first", firstView(capture, settings.volume));
    run = new Run(gpu.trainer, capture, settings, options, {
        onProgress: (progress) => {
            // The page has a button that stops instead of the one that cancels.
            cancelling = null;
            tell("progress", progress);
        },
        onPicture: (picture) => tell("picture", { picture }),
        onComplaint: (text) => tell("complaint", { text }),
        onBegin: async (begun) => {
            isKept = await isStored(keeper?.begin(name, begun, options));
            canGoOn = await tellOfKept();
        },
        onCheckpoint: async (checkpoint) => {
            isKept &&= await isStored(checkpoint && keeper.keep(checkpoint));
            canGoOn = await tellOfKept();
        },
    });
    const scene = await gpu.loss.unless(work(run), () => (canGoOn ? LOST_WHILE_KEPT : LOST_UNKEPT));
    tell("done", { scene: await filesOf(scene), isKept });
    serving = gpu.loss.unless(run.serve(), () => LOST_AT_REST).catch(complain);
}

/** Whether the run is kept. Where there is no room for it, the page trains all the same, and says so. */
async function isStored(keeping) {
    const isKept = (await keeping?.then(() => true, () => false)) ?? false;
    if (!isKept) {
        tell("complaint", { text: NOT_KEPT });
    }
    return isKept;
}

/** The scene in all formats that can hold it. */
async function filesOf(scene) {
    const packing = async (share) => tell("stage", { text: "packing the scene", share });
    const pgs = await pgsOf(scene, settings.pgs, packing).catch(complain);
    return { ply: plyOf(scene), spz: await spzOf(scene).catch(complain), pgs };
}

async function failed(error) {
    if (cancelling?.signal.aborted) {
        tell("cancelled");
    } else {
        fault(error.message);
    }
    await tellOfKept();
}

/** Open the browser's storage, unless another page holds it: then this one goes on without until that is closed. */
function openKept() {
    return new Promise((resolve) => {
        const onWait = () => {
            tell("complaint", { text: KEPT_ELSEWHERE });
            resolve();
        };
        KeptRun.open(version, onWait).then((opened) => {
            kept = opened;
            // Before the settings, for which a capture may wait: it would take the kept run's place unasked.
            return tellOfKept().finally(resolve);
        });
    });
}

/** @returns {Promise<boolean>} whether a run is kept that the last one has begun, or goes on with */
async function tellOfKept() {
    const found = (await kept?.summary()) ?? null;
    tell("kept", { found });
    return found !== null && keeper !== null;
}

/**
 * @typedef {Object} Gpu
 * @property {Trainer} trainer
 * @property {Stereo} stereo
 * @property {FeatureFinder} finder
 * @property {NeighbourSearch} search
 * @property {GpuLoss} loss
 * @property {Promise<GPUDeviceLostInfo>} lost resolves when the GPU is lost
 *
 * @returns {Promise<Gpu>}
 */
function openGpu() {
    return onDevice(async (device) => {
        device.addEventListener("uncapturederror", ({ error }) => tell("complaint", { text: error.message }));
        const trainer = await Trainer.open(device, passes, settings);
        const stereo = await Stereo.open(device, depthPasses, settings.prior.sweep);
        const finder = await FeatureFinder.open(device, featuresPasses, settings.prior.features);
        const search = await NeighbourSearch.open(device, seedingPasses, settings.seeding);
        return { trainer, stereo, finder, search, loss: new GpuLoss(device), lost: device.lost };
    });
}

/** The capture with its photographs, as large as they fit, and the plan. */
async function opened({ archive, files }, wish) {
    const showStage = (text) => (done, of) => {
        cancelling.signal.throwIfAborted();
        tell("stage", { text: `${text} ${done} of ${of}`, share: done / of });
    };
    await stage("opening the capture");
    const stored = archive
        ? await filesInZip(archive, archive.name)
        : files.map(({ path, file }) => StoredFile.ofDisk(file, path));
    const found = await readListing(new FileTree(stored), settings.capture, showStage("seeking sharp frames,"));
    const listing = wish.prior === "dense" ? found : withoutDepth(found);
    const outline = await outlineOf(listing, settings.capture);
    const { trainer, stereo } = await opening.get();
    const device = { ...trainer.device, depth: stereo.descriptions };
    const plan = planRun(outline, wish, device, settings);
    tell("plan", { text: plan.text });
    const capture = await loadCapture(listing, plan.most, settings, showStage("photograph"));
    tell("capture", { warnings: capture.warnings });
    return [capture, plan];
}

async function fetched(name) {
    const response = await fetch(new URL(name, import.meta.url));
    if (!response.ok) {
        throw new Error(`${name}: the server answers ${response.status}`);
    }
    return response.json();
}

/**
 * Say what is done next before training.
 *
 * @param {string} text
 * @param {number} share that is done
 * @param {number} bytes of the GPU's buffers
 * @throws {DOMException} the user has cancelled
 */
async function stage(text, share = 0, bytes = 0) {
    tell("stage", { text, share, bytes });
    // Messages that have arrived come first.
    await new Promise((resolve) => setTimeout(resolve));
    cancelling.signal.throwIfAborted();
}

/** Tell of an error that the run survives. */
function complain({ message }) {
    tell("complaint", { text: message });
}

function fault(text) {
    tell("fault", { text });
}

function tell(type, content = {}) {
    self.postMessage({ type, ...content });
}
