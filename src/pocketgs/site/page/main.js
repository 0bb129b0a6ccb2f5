/**
 * The page's entry point. Everything is computed in a worker.
 *
 * @module
 */

import { listenForCaptures } from "./controls/pick.js";
import { ProgressView } from "./controls/progress.js";
import { ScenePicture } from "./controls/scene_picture.js";
import { keepAwake } from "./controls/wake_lock.js";

const OPTIONS = ["most", "iterations", "gaussians"];

const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
const progressView = new ProgressView();
const picture = new ScenePicture(
    element("picture"),
    (camera) => worker.postMessage({ type: "look", camera }),
    () => showBeside(false),
);
let name = "";
let isTraining = false;
let isPaused = false;
/** @type {{name: string, iteration: number, iterations: number} | null} a run that can go on */
let kept = null;
/** @type {Blob | null} */
let ply = null;

const handlers = {
    settings: ({ run }) => {
        element("iterations").value = run.iterations;
        element("gaussians").value = run.gaussians;
        element("start").hidden = false;
    },
    kept: ({ found }) => {
        kept = found;
        element("kept").hidden = !found;
        if (found) {
            element("go-on").textContent = `Go on with ${found.name}, ${found.iteration} of ${found.iterations}`;
        }
    },
    ready: () => (document.body.dataset.gpu = "ready"),
    stage: ({ text, share }) => progressView.showStage(text, share),
    capture: ({ warnings }) => warnings.length && showMessage(warnings.join("\n\n")),
    first: (view) => {
        element("pictures").hidden = false;
        showPhotograph(view);
        showBeside(true);
        picture.begin(view);
    },
    picture: (found) => picture.show(found.picture),
    progress: (progress) => {
        progressView.showProgress(progress);
        picture.refresh();
    },
    done: (found) => {
        ply = found.ply;
        setTraining(false);
        element("kept").hidden = true;
        progressView.end();
        picture.redraw();
    },
    complaint: ({ text }) => showMessage(text),
    fault: ({ text }) => {
        setTraining(false);
        element("live").hidden = element("pictures").hidden = true;
        element("start").hidden = false;
        showMessage(text);
    },
};

worker.addEventListener("message", ({ data }) => handlers[data.type](data));
worker.addEventListener("error", (event) => {
    event.preventDefault();
    showMessage(`The page could not be loaded: ${event.message ?? "the server did not answer"}`);
});

listenForCaptures((picked) => {
    if (isTraining) {
        showMessage("A capture is being trained: stop it first.");
        return;
    }
    element("start").hidden = false;
    if (!OPTIONS.map(element).every((input) => input.reportValidity())) {
        return;
    }
    const options = Object.fromEntries(OPTIONS.map((id) => [id, element(id).valueAsNumber]));
    begin(picked.name, options.iterations);
    worker.postMessage({ type: "train", picked, options });
});

element("go-on").addEventListener("click", () => {
    begin(kept.name, kept.iterations);
    worker.postMessage({ type: "go on" });
});

function begin(title, iterations) {
    [name, isPaused, ply] = [title, false, null];
    setTraining(true);
    for (const id of ["message", "start", "pictures", "kept"]) {
        element(id).hidden = true;
    }
    element("title").textContent = title;
    progressView.begin(iterations);
}

element("pause").addEventListener("click", () => {
    isPaused = !isPaused;
    worker.postMessage({ type: isPaused ? "pause" : "resume" });
    element("pause").textContent = isPaused ? "Resume" : "Pause";
});

element("stop").addEventListener("click", () => worker.postMessage({ type: "stop" }));

element("save").addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(ply);
    link.download = `${name}.ply`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
});

element("another").addEventListener("click", () => (element("start").hidden = false));

element("beside").addEventListener("click", () => {
    showBeside(true);
    picture.reset();
});

element("message-close").addEventListener("click", () => (element("message").hidden = true));

window.addEventListener("beforeunload", (event) => isTraining && event.preventDefault());

// Systems end hidden pages without asking.
document.addEventListener("visibilitychange", () => document.hidden && worker.postMessage({ type: "keep" }));

function setTraining(training) {
    isTraining = training;
    keepAwake(training);
}

/** The photograph beside the rendering, which hides it once it is turned. */
function showBeside(isBeside) {
    element("photograph-figure").hidden = !isBeside;
    element("beside").hidden = isBeside;
}

function showPhotograph({ camera: { width, height }, rgba }) {
    const canvas = element("photograph");
    [canvas.width, canvas.height] = [width, height];
    canvas.getContext("2d").putImageData(new ImageData(rgba, width, height), 0, 0);
}

function showMessage(text) {
    element("message-text").textContent = text;
    element("message").hidden = false;
}

function element(id) {
    return document.getElementById(id);
}
