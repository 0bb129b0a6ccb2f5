/**
 * The worker in which everything is computed, so that the page stays responsive: reading, seeding, training.
 *
 * @module
 */

import { FileTree, StoredFile } from "./archive/tree.js";
import { filesInZip } from "./archive/zip.js";
import { loadCapture, readListing } from "./capture/open.js";
import { plyOf } from "./formats/ply_writer.js";
import { Run } from "./training/run.js";
import { Trainer } from "./training/trainer.js";

/**
 * @typedef {Object} Picked what the user chose: one archive, or the files of a folder
 * @property {string} name
 * @property {File | null} archive
 * @property {{path: string, file: File}[]} files
 */

const settings = await fetched("settings.json");
/** @type {Run | null} */
let run = null;
let isBusy = false;

// Shaders are compiled while the user chooses a capture.
const opening = fetched("passes.json").then((passes) => Trainer.open(passes, settings, fault));
opening.then(() => tell("ready"), (error) => fault(error.message));
tell("settings", { run: settings.run });

self.addEventListener("message", async ({ data }) => {
    if (data.type === "train" && !isBusy) {
        isBusy = true;
        await train(data.picked, data.options).catch((error) => fault(error.message));
        [isBusy, run] = [false, null];
    } else if (["pause", "resume", "stop"].includes(data.type)) {
        run?.[data.type]();
    }
});

/** @type {(picked: Picked, options: {most: number, iterations: number, gaussians: number}) => Promise<void>} */
async function train({ name, archive, files }, { most, ...options }) {
    tell("stage", { text: "opening the capture" });
    const stored = archive ? await filesInZip(archive, name) : files.map(({ path, file }) => StoredFile.ofDisk(file, path));
    const listing = await readListing(new FileTree(stored), settings.capture);
    const capture = await loadCapture(listing, most, settings, (done, of) => {
        tell("stage", { text: `photograph ${done} of ${of}`, share: done / of });
    });
    tell("capture", { views: capture.train.length, heldOut: capture.heldOut.length, warnings: capture.warnings });
    tell("stage", { text: "compiling shaders" });
    const trainer = await opening;
    tell("stage", { text: "placing Gaussians" });
    run = new Run(trainer, capture, settings, { seed: settings.run.seed, ...options }, {
        onProgress: (progress) => tell("progress", progress),
        onPicture: (picture) => tell("picture", { picture }),
    });
    tell("photograph", { picture: { ...sizeOf(run.shown), rgba: opaque(run.shown.rgba) } });
    const scene = await run.go();
    tell("done", { ply: plyOf(scene), gaussians: scene.count });
}

const sizeOf = ({ camera: { width, height } }) => ({ width, height });

const opaque = (rgba) => rgba.map((value, i) => (i % 4 < 3 ? value : 255));

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
