/**
 * The page's entry point: asks the server again and again how things are, and passes on what the user wants.
 *
 * @module
 */

import { askBeforeLeaving } from "../page/controls/leaving.js";
import { element } from "../page/element.js";
import { CaptureList } from "./captures.js";
import { askForNew, askForTitle, showMenu } from "./dialogs.js";
import { choose, problemWith } from "./files.js";
import { ask, tell } from "./server.js";
import { hideToast, showToast } from "./toast.js";
import { showTrash } from "./trash.js";
import { matched, Upload } from "./upload.js";
import { keepAwake } from "./wake_lock.js";

const SECONDS_BETWEEN_LOOKS = 1;

/** @type {Map<string, Upload>} by the captures' ids */
const uploads = new Map();
const list = new CaptureList((action, capture) => attempt(() => act(action, capture)));
/** What the computer has and takes. Files can be chosen once it is known. */
let shelf = null;
const beginButtons = document.querySelectorAll("#choices button");
/** Whether the server is asked to take a capture. If it refuses, the dialog opens again, with the files of this one. */
let isBeginning = false;

async function look() {
    if (document.visibilityState === "visible") {
        await refresh().catch(() => {});
    }
    setTimeout(look, 1000 * SECONDS_BETWEEN_LOOKS);
}

async function refresh() {
    try {
        shelf = await ask("shelf.json");
        element("connection").hidden = true;
    } catch (error) {
        element("connection").hidden = false;
        throw error;
    }
    enableBeginning();
    list.show(shelf.captures, (id) => uploads.has(id), uploads.size > 0);
    showTrash(shelf.deleted, (id) => attempt(() => tell(`captures/${id}/restore`)));
}

function enableBeginning() {
    beginButtons.forEach((button) => (button.disabled = shelf === null || isBeginning));
}

/** Do something, and show what goes wrong and what has changed. */
async function attempt(work) {
    try {
        await work();
    } catch (error) {
        showToast(error.message);
    }
    await refresh().catch(() => {});
}

async function act(action, capture) {
    const path = `captures/${capture.id}`;
    if (action === "menu") {
        showMenu(capture, shelf.efforts, (chosen) => attempt(() => act(chosen, capture)));
    } else if (action === "continue") {
        await goOnUploading(capture);
    } else if (action === "rename") {
        const title = await askForTitle(capture.title, shelf.bounds);
        await (title && tell(`${path}/rename`, { title }));
    } else if (action === "delete") {
        await tell(`${path}/delete`);
        uploads.get(capture.id)?.cancel();
        showToast(`Deleted ${capture.title}`, () => attempt(() => tell(`${path}/restore`)));
    } else if (action.startsWith("train-")) {
        await tell(`${path}/train`, { effort: action.slice("train-".length) });
    } else {
        await tell(`${path}/${action}`);
    }
}

async function begin(kind) {
    const files = await choose(kind, shelf.suffixes);
    if (files.length === 0) {
        return;
    }
    const stated = files.map(({ name, size }) => ({ name, size }));
    const declare = async (chosen) => {
        isBeginning = true;
        enableBeginning();
        try {
            return await tell("captures", { ...chosen, files: stated });
        } finally {
            isBeginning = false;
            enableBeginning();
        }
    };
    const begun = await askForNew(files, problemWith(files, shelf), shelf, declare);
    if (begun) {
        hideToast();
        await upload(begun.id, files);
    }
}

async function goOnUploading(capture) {
    const files = await choose(capture.kind, shelf.suffixes);
    if (files.length > 0) {
        await upload(capture.id, files);
    }
}

async function upload(id, files) {
    const pairs = matched(await ask(`captures/${id}/files.json`), files);
    if (!pairs) {
        throw new Error("These are other files than those of this upload: choose the same ones.");
    }
    const sending = new Upload(id, pairs);
    uploads.set(id, sending);
    keepAwake(true);
    try {
        await sending.send();
    } finally {
        uploads.delete(id);
        keepAwake(uploads.size > 0);
    }
}

for (const button of beginButtons) {
    button.addEventListener("click", () => attempt(() => begin(button.dataset.kind)));
}
element("empty-trash").addEventListener("click", () => attempt(() => tell("trash/empty")));
document.addEventListener("visibilitychange", () => refresh().catch(() => {}));
askBeforeLeaving(() => uploads.size > 0);
look();
