/**
 * The worker in which everything is computed, so that the page stays responsive: reading, seeding, training.
 *
 * @module
 */

import { FileTree, StoredFile } from "./archive/tree.js";
import { filesInZip } from "./archive/zip.js";
import { loadCapture, readListing } from "./capture/open.js";
import { plyOf } from "./formats/ply_writer.js";
import { firstView } from "./training/first_view.js";
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
/** Until the last run's pictures are drawn. */
let serving = Promise.resolve();

// Shaders are compiled while the user chooses a capture.
const opening = fetched("passes.json").then((passes) => Trainer.open(passes, settings, fault));
opening.then(() => tell("ready"), (error) => fault(error.message));
tell("settings", { run: settings.run });

self.addEventListener("message", async ({ data }) => {
    if (data.type === "train") {
        await train(data.picked, data.options).catch((error) => fault(error.message));
    } else if (data.type === "look") {
        run?.look(data.camera);
    } else {
        run?.[data.type]();
    }
});

/** @type {(picked: Picked, options: {most: number, iterations: number, gaussians: number}) => Promise<void>} */
async function train(picked, { most, ...options }) {
    run?.close();
    run = null;
    await serving;
    const capture = await opened(picked, most);
    tell("stage", { text: "compiling shaders" });
    const trainer = await opening;
    tell("stage", { text: "placing splats" });
    tell("first", firstView(capture, settings.volume));
    run = new Run(trainer, capture, settings, { seed: settings.run.seed, ...options }, {
        onProgress: (progress) => tell("progress", progress),
        onPicture: (picture) => tell("picture", { picture }),
    });
    tell("done", { ply: plyOf(await run.go()) });
    serving = run.serve().catch((error) => fault(error.message));
}

async function opened({ name, archive, files }, most) {
    tell("stage", { text: "opening the capture" });
    const stored = archive ? await filesInZip(archive, name) : files.map(({ path, file }) => StoredFile.ofDisk(file, path));
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
