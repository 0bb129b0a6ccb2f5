/**
 * The toolbar's buttons, and their keyboard shortcuts.
 *
 * @module
 */

import { element } from "../element.js";
import { listenToKeyboard } from "./keyboard.js";
import { save } from "./saving.js";

/**
 * @typedef {import("../drawing/scene_view.js").SceneView} SceneView
 * @typedef {import("./capture_cameras.js").CaptureCameras} CaptureCameras
 */

const APPEARANCES = ["splats", "points", "discs", "depth"];

/**
 * Connect buttons and keys.
 *
 * @param {SceneView} view
 * @param {CaptureCameras} cameras
 * @param {{onFault: (text: string) => void}} options
 */
export function connectToolbar(view, cameras, { onFault }) {
    const help = element("help");
    const actions = {
        previous: () => cameras.go(-1),
        next: () => cameras.go(1),
        reset: () => cameras.reset(),
        "compare-button": () => cameras.compare(),
        background: () => view.changeBackground(),
        screenshot: () => savePicture(view).catch((error) => onFault(error.message)),
        "full-screen": () => toggleFullScreen(),
        "help-button": () => {
            help.showModal();
            help.scrollTop = 0; // the browser shows the button that has the focus, which is the last
        },
    };
    for (const [id, action] of Object.entries(actions)) {
        element(id).addEventListener("click", action);
    }
    element("full-screen").hidden = !document.fullscreenEnabled;

    const appear = (appearance) => chooseAppearance(view, appearance).catch((error) => onFault(error.message));
    for (const button of appearanceButtons()) {
        button.addEventListener("click", () => appear(button.dataset.appearance));
    }
    listenToKeyboard(view.camera, view.loop, () => cameras.stopComparing(), {
        arrowleft: actions.previous,
        arrowright: actions.next,
        r: actions.reset,
        c: actions["compare-button"],
        b: actions.background,
        p: actions.screenshot,
        f: actions["full-screen"],
        o: () => element("open").click(),
        "?": actions["help-button"],
        escape: () => cameras.stopComparing(),
        ...Object.fromEntries(APPEARANCES.map((appearance, i) => [String(i + 1), () => appear(appearance)])),
    });
}

async function chooseAppearance(view, appearance) {
    await view.setAppearance(appearance);
    for (const button of appearanceButtons()) {
        button.setAttribute("aria-pressed", String(button.dataset.appearance === appearance));
    }
}

function appearanceButtons() {
    return document.querySelectorAll("#appearances button");
}

function toggleFullScreen() {
    return document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
}

async function savePicture(view) {
    const title = element("title").textContent; // of the scene that is shown now
    await save(await view.photograph(), `${title}.png`);
}
