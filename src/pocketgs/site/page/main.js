/**
 * The page's entry point. Everything is computed in a worker.
 *
 * @module
 */

import { askBeforeLeaving } from "../page/controls/leaving.js";
import { save } from "../page/controls/saving.js";
import { element } from "../page/element.js";
import { keepFocusIn } from "./controls/focus.js";
import { askForLastingStorage } from "./controls/lasting_storage.js";
import { listenForCaptures } from "./controls/pick.js";
import { ProgressView } from "./controls/progress.js";
import { ScenePicture } from "./controls/scene_picture.js";
import { keepAwake } from "./controls/wake_lock.js";

const OPTIONS = ["most", "iterations", "gaussians", "budget"];

/** Formats in which a scene is saved. */
const FORMATS = ["ply", "spz", "pgs"];

/** Characters of a message: names in broken files may be of any length. */
const MOST_SHOWN = 1000;

const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
const progressView = new ProgressView();
const picture = new ScenePicture(
    element("picture"),
    (camera) => worker.postMessage({ type: "look", camera }),
    () => showBeside(false),
);
let name = "";
let isTraining = false;
/** @type {{name: string, iteration: number, iterations: number, canGoOn: boolean} | null} the kept run */
let kept = null;
/** @type {Object<string, Blob | undefined>} the trained scene by format */
let scene = {};
let isSaved = false;
/** Whether the scene is that of the kept run. */
let isKept = false;
/** Whether the browser will not delete what is kept. */
let isLasting = false;
/** Once training begins: before, users would not know what they are asked for. */
let asking = null;
/** Whether the kept run, as far as it is known, has been saved. */
let isKeptSaved = false;

let onSettings;
/** Fulfilled once the fields have their values. */
const settled = new Promise((resolve) => (onSettings = resolve));

const handlers = {
    settings: ({ run, plan }) => {
        element("iterations").value = run.iterations;
        element("gaussians").value = run.gaussians;
        element("budget").value = plan.most_memory;
        element("start").hidden = false;
        onSettings();
    },
    kept: ({ found }) => {
        kept = found;
        element("kept").hidden = !found;
        if (found) {
            const { name, iteration, iterations, canGoOn } = found;
            element("go-on").textContent = `${canGoOn ? "Go on with" : "Open"} ${name}, ${iteration} of ${iterations}`;
            element("changed").hidden = canGoOn;
        }
    },
    ready: () => (document.body.dataset.gpu = "ready"),
    stage: ({ text, share, bytes }) => progressView.showWork(text, share, bytes),
    plan: ({ text }) => progressView.showPlan(text),
    capture: ({ warnings }) => warnings.length && showMessage(warnings.join("\n\n")),
    first: (view) => {
        element("pictures").hidden = false;
        showPhotograph(view);
        showBeside(true);
        picture.begin(view);
    },
    picture: (found) => picture.show(found.picture),
    progress: (progress) => {
        asking ??= askForLastingStorage().then((granted) => (isLasting = granted));
        isKeptSaved = false;
        progressView.showProgress(progress);
        picture.refresh();
    },
    done: (found) => {
        [scene, isKept] = [found.scene, found.isKept];
        FORMATS.forEach((format) => (element(`save-${format}`).disabled = !scene[format]));
        setTraining(false);
        // The run that can go on is this one, unless this one is not kept.
        element("kept").hidden = isKept || !kept;
        progressView.end();
        picture.redraw();
    },
    complaint: ({ text }) => addMessage(text),
    cancelled: backToStart,
    fault: ({ text }) => {
        backToStart();
        showMessage(text);
    },
};

worker.addEventListener("message", ({ data }) => handlers[data.type](data));
worker.addEventListener("error", (event) => {
    event.preventDefault();
    showMessage(`The page could not be loaded: ${event.message ?? "the server did not answer"}`);
});

listenForCaptures(async (picked) => {
    await settled; // what is dropped while the page loads begins then
    if (isTraining) {
        showMessage("A capture is being trained: stop it first.");
        return;
    }
    showStart();
    if (!OPTIONS.map(element).every((input) => input.reportValidity())) {
        return;
    }
    const lost = sceneLost() || keptRunLost();
    if (lost && !confirm(`${lost} Train another all the same?`)) {
        return;
    }
    const [most, iterations, gaussians, megabytes] = OPTIONS.map((id) => element(id).valueAsNumber);
    begin(picked.name, iterations);
    const { width, height } = window.screen;
    const prior = element("depth").checked ? "dense" : "none";
    const refines = element("refines").checked;
    const options = { most, iterations, gaussians, prior, refines, bytes: 1e6 * megabytes, screen: { width, height } };
    worker.postMessage({ type: "train", picked, options });
}, showMessage);

// Without depth poses stay as they are.
element("depth").addEventListener("change", ({ target }) => (element("refines").disabled = !target.checked));

element("go-on").addEventListener("click", () => {
    if (sceneLost() && !confirm(`${sceneLost()} Go on all the same?`)) {
        return;
    }
    begin(kept.name, kept.iterations);
    worker.postMessage({ type: kept.canGoOn ? "go on" : "give" });
});

/** What is lost with the scene that is shown, as a sentence; "" if nothing is. */
function sceneLost() {
    return isFleeting() ? "The trained scene is not saved, and would be lost." : "";
}

/** Whether the scene may be lost with the page: it is not saved, and if it is kept, the browser may delete it. */
const isFleeting = () => hasScene() && !isSaved && !(isKept && isLasting);

/** What is lost with the kept run once another one trains, likewise. */
function keptRunLost() {
    const goesOn = kept?.canGoOn && kept.iteration < kept.iterations;
    if (!kept || (isKeptSaved && !goesOn)) {
        return "";
    }
    const state = goesOn ? "is not finished" : "is not saved";
    return `The kept run of ${kept.name} ${state}, and would be replaced.`;
}

function begin(title, iterations) {
    [name, scene, isSaved] = [title, {}, false];
    setTraining(true);
    for (const id of ["message", "start", "pictures", "kept"]) {
        element(id).hidden = true;
    }
    element("title").textContent = title;
    progressView.begin(iterations);
}

element("pause").addEventListener("click", () => {
    worker.postMessage({ type: progressView.pause() ? "pause" : "resume" });
});

element("cancel").addEventListener("click", () => worker.postMessage({ type: "cancel" }));

element("stop").addEventListener("click", () => worker.postMessage({ type: "stop" }));

for (const format of FORMATS) {
    element(`save-${format}`).addEventListener("click", async () => {
        if (await save(scene[format], `${name}.${format}`)) {
            [isSaved, isKeptSaved] = [true, isKept];
        }
    });
}

element("another").addEventListener("click", () => {
    showStart();
    element("choose-archive").focus();
});

element("back").addEventListener("click", hideStart);

document.addEventListener("keydown", ({ key }) => key === "Escape" && hideStart());

element("beside").addEventListener("click", () => {
    showBeside(true);
    picture.reset();
});

element("message-close").addEventListener("click", () => (element("message").hidden = true));

askBeforeLeaving(() => isTraining || isFleeting());

// Systems end hidden pages without asking.
document.addEventListener("visibilitychange", () => {
    if (document.hidden && isTraining) {
        worker.postMessage({ type: "keep" });
    }
});

function backToStart() {
    setTraining(false);
    element("live").hidden = element("pictures").hidden = true;
    showStart();
}

/** The card to begin with. On phones it covers the scene, to which there is a way back. */
function showStart() {
    element("start").hidden = false;
    element("back").hidden = !hasScene();
    keepFocusIn(element("start"));
}

function hideStart() {
    if (hasScene() && !element("start").hidden) {
        element("start").hidden = true;
        element("another").focus();
    }
}

const hasScene = () => Object.keys(scene).length > 0;

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
    element("message-text").textContent = cut(text);
    element("message").hidden = false;
}

/** Say it beside what has not been read yet: there may be several complaints of a run. */
function addMessage(text) {
    const shown = element("message-text").textContent;
    if (element("message").hidden || shown.length > MOST_SHOWN) {
        showMessage(text);
    } else if (!shown.includes(cut(text))) {
        element("message-text").textContent = `${shown}\n\n${cut(text)}`;
    }
}

const cut = (text) => (text.length > MOST_SHOWN ? `${text.slice(0, MOST_SHOWN)} …` : text);
