/**
 * Dialogs: what to call a new capture, what to do with one, and how to rename it.
 *
 * @module
 */

import { element } from "../page/element.js";
import { sizeOf } from "../page/size_text.js";
import { EFFORTS } from "./words.js";

for (const button of document.querySelectorAll("[data-close]")) {
    button.addEventListener("click", () => button.closest("dialog").close());
}

// A title of nothing but spaces is missing, which the browser says by itself.
for (const field of document.querySelectorAll("dialog .field")) {
    field.addEventListener("change", () => (field.value = field.value.trim()));
}

/**
 * Ask for the title and the effort of a new capture, until the server takes it or the user cancels. The files stay
 * chosen meanwhile.
 *
 * @template Begun
 * @param {File[]} files
 * @param {string} problem why these files cannot be uploaded, or ""
 * @param {{ efforts: string[], effort: string, bounds: Object }} shelf
 * @param {(chosen: { title: string, effort: string }) => Promise<Begun>} begin asks the server
 * @returns {Promise<Begun | null>} null if the user cancels
 */
export async function askForNew(files, problem, { efforts, effort, bounds }, begin) {
    const total = files.reduce((sum, file) => sum + file.size, 0);
    const what = files.length === 1 ? files[0].name : `${files.length} photos`;
    element("begin-title").textContent = `${what}, ${sizeOf(total)}`;
    showProblem(problem);
    element("begin-upload").disabled = problem !== "";
    element("begin-name").maxLength = bounds.title;
    element("begin-name").value = titleFor(files, bounds.title);
    element("begin-effort").replaceChildren(...efforts.map((each) => choice(each, each === effort)));
    while (await confirmed("begin")) {
        const chosen = element("begin-effort").querySelector(":checked").value;
        try {
            return await begin({ title: element("begin-name").value, effort: chosen });
        } catch ({ message }) {
            showProblem(message);
        }
    }
    return null;
}

function showProblem(text) {
    element("begin-problem").textContent = text;
    element("begin-problem").hidden = text === "";
}

/** Ask for another title. @returns {Promise<string | null>} */
export async function askForTitle(title, bounds) {
    element("rename-name").maxLength = bounds.title;
    element("rename-name").value = title;
    return (await confirmed("rename")) ? element("rename-name").value : null;
}

/**
 * Show what can be done with a capture.
 *
 * @param {Object} capture
 * @param {string[]} efforts
 * @param {(action: string) => void} onAction
 */
export function showMenu({ id, title, state, result, can_go_on: canGoOn }, efforts, onAction) {
    const menu = element("menu");
    element("menu-title").textContent = title;
    element("menu-downloads").hidden = result === null;
    for (const link of menu.querySelectorAll("a")) {
        link.href = `captures/${id}/scene${link.dataset.suffix}`;
        link.onclick = () => menu.close();
    }
    const isIdle = ["trained", "failed", "stopped"].includes(state);
    element("menu-train").hidden = !isIdle;
    const choices = efforts.map((effort) => button(EFFORTS[effort] ?? effort, `train-${effort}`));
    element("menu-efforts").replaceChildren(...choices);
    menu.querySelector("[data-action=go-on]").hidden = !(isIdle && canGoOn);
    menu.querySelector("[data-action=stop]").hidden = state !== "queued";
    for (const each of menu.querySelectorAll("[data-action]")) {
        each.onclick = () => {
            menu.close();
            onAction(each.dataset.action);
        };
    }
    menu.showModal();
}

/** Show a dialog with a form; returns whether it was submitted. */
function confirmed(id) {
    const dialog = element(id);
    let submitted = false;
    dialog.querySelector("form").onsubmit = () => (submitted = true);
    dialog.showModal();
    return new Promise((resolve) => dialog.addEventListener("close", () => resolve(submitted), { once: true }));
}

/** Fields, and so `most`, count UTF-16's units: what is cut may be half a character, which is left out. */
function titleFor(files, most) {
    if (files.length === 1) {
        const title = files[0].name.replace(/\.[^.]*$/, "") || files[0].name;
        return title.slice(0, most).replace(/\p{Surrogate}/gu, "").trim();
    }
    return new Date().toLocaleString("en-GB", { day: "numeric", month: "long", hour: "2-digit", minute: "2-digit" });
}

function choice(effort, isChecked) {
    const label = document.createElement("label");
    const input = document.createElement("input");
    Object.assign(input, { type: "radio", name: "effort", value: effort, checked: isChecked });
    label.append(input, EFFORTS[effort] ?? effort);
    return label;
}

function button(text, action) {
    const made = document.createElement("button");
    made.className = "wide";
    made.textContent = text;
    made.dataset.action = action;
    return made;
}
