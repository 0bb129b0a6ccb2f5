/**
 * The page's entry point. Everything is computed in a worker.
 *
 * @module
 */

import { listenForCaptures } from "./controls/pick.js";
import { ProgressView } from "./controls/progress.js";

const OPTIONS = ["most", "iterations", "gaussians"];

const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
const view = new ProgressView();
let capture = "";
let isPaused = false;
/** @type {Blob | null} */
let ply = null;

const handlers = {
    settings: ({ run }) => {
        element("iterations").value = run.iterations;
        element("gaussians").value = run.gaussians;
        element("start").hidden = false;
    },
    ready: () => (document.body.dataset.gpu = "ready"),
    stage: ({ text, share }) => view.showStage(text, share),
    capture: ({ warnings }) => warnings.length && showMessage(warnings.join("\n\n")),
    photograph: ({ picture }) => view.showPicture("photograph", picture),
    picture: ({ picture }) => view.showPicture("picture", picture),
    progress: (progress) => view.showProgress(progress),
    done: (found) => {
        ply = found.ply;
        view.end();
        element("start").hidden = false;
    },
    fault: ({ text }) => {
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
    if (element("start").hidden) {
        showMessage("A capture is being trained: stop it first.");
        return;
    }
    const wrong = OPTIONS.map(element).find((input) => !input.reportValidity());
    if (wrong) {
        return;
    }
    [capture, isPaused, ply] = [picked.name.replace(/\.zip$/i, ""), false, null];
    element("message").hidden = element("start").hidden = true;
    element("title").textContent = capture;
    const options = Object.fromEntries(OPTIONS.map((id) => [id, element(id).valueAsNumber]));
    view.begin(options.iterations);
    worker.postMessage({ type: "train", picked, options });
});

element("pause").addEventListener("click", () => {
    isPaused = !isPaused;
    worker.postMessage({ type: isPaused ? "pause" : "resume" });
    element("pause").textContent = isPaused ? "Resume" : "Pause";
});

element("stop").addEventListener("click", () => worker.postMessage({ type: "stop" }));

element("save").addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(ply);
    link.download = `${capture}.ply`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
});

element("message-close").addEventListener("click", () => (element("message").hidden = true));

function showMessage(text) {
    element("message-text").textContent = text;
    element("message").hidden = false;
}

function element(id) {
    return document.getElementById(id);
}
