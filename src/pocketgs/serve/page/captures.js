/**
 * The list of captures. Titles and messages are text, never markup.
 *
 * @module
 */

import { shareOf, stateOf } from "./words.js";

/** Shows captures, and says what is asked of them. */
export class CaptureList {
    #list = document.getElementById("captures");
    #template = document.getElementById("capture");
    #items = new Map();
    #onAction;

    /** @param {(action: string, capture: Object) => void} onAction */
    constructor(onAction) {
        this.#onAction = onAction;
    }

    /**
     * @param {Object[]} captures what the server tells about them, in order
     * @param {(id: string) => boolean} isHere whether this page uploads one
     * @param {boolean} stays whether links must not leave this page
     */
    show(captures, isHere, stays) {
        const focused = [...this.#list.children].indexOf(document.activeElement.closest("#captures > li"));
        const known = new Set(captures.map(({ id }) => id));
        for (const [id, item] of this.#items) {
            if (!known.has(id)) {
                item.element.remove();
                this.#items.delete(id);
            }
        }
        captures.forEach((capture, index) => {
            const item = this.#items.get(capture.id) ?? this.#add(capture.id);
            item.capture = capture;
            update(item.element, capture, isHere(capture.id), stays);
            if (this.#list.children[index] !== item.element) {
                this.#list.insertBefore(item.element, this.#list.children[index] ?? null);
            }
        });
        if (focused >= 0) {
            keepFocus(this.#list.children[Math.min(focused, captures.length - 1)]);
        }
    }

    #add(id) {
        const element = this.#template.content.firstElementChild.cloneNode(true);
        const item = { element, capture: null };
        element.dataset.id = id;
        const act = element.querySelector(".act");
        act.addEventListener("click", () => this.#onAction(act.dataset.action, item.capture));
        element.querySelector(".more").addEventListener("click", () => this.#onAction("menu", item.capture));
        this.#items.set(id, item);
        return item;
    }
}

/** Those who use the keyboard or a screen reader would lose their place when what had the focus is gone or hidden. */
function keepFocus(item) {
    const holder = document.activeElement;
    if (holder === document.body || !holder.checkVisibility()) {
        (item?.querySelector(".more") ?? document.querySelector("#choices button")).focus();
    }
}

function update(element, capture, isHere, stays) {
    const part = (selector) => element.querySelector(selector);
    const { id, kind, state, title, message, thumbnail } = capture;
    element.dataset.state = state;
    setText(part("bdi"), title);
    setText(part(".state"), stateOf(capture, isHere));
    setText(part(".message"), message);
    part(".message").hidden = message === "";
    showShare(part("progress"), shareOf(capture));
    const picture = thumbnail === null ? null : `captures/${id}/thumbnail.jpg?${thumbnail}`;
    setAttribute(part("img"), "src", picture);
    setAttribute(part(".picture use"), "href", `#icon-${kind}`);
    const isOpen = capture.live || (capture.result !== null && state !== "training");
    for (const link of element.querySelectorAll("a")) {
        setAttribute(link, "href", isOpen ? `captures/${id}/view/` : null);
        setAttribute(link, "target", stays ? "_blank" : null);
    }
    setAttribute(part(".picture"), "aria-label", isOpen ? `Open ${title}` : null);
    part(".open").hidden = !isOpen;
    setAttribute(part("progress"), "aria-label", `Progress of ${title}`);
    setAttribute(part(".more"), "aria-label", `More about ${title}`);
    setText(part(".open"), state === "training" ? "Watch" : "Open");
    const [action, label] = actionOf(capture, isHere);
    part(".act").hidden = action === null;
    part(".act").dataset.action = action ?? "";
    setText(part(".act"), label ?? "");
}

/** The button beside *Open*: what is most likely wanted. */
function actionOf({ state, active, progress, effort, result }, isHere) {
    if (state === "uploading" && !isHere && !active) {
        return ["continue", "Continue"];
    }
    if (state === "training") {
        return ["stop", progress?.iteration ? "Stop and keep" : "Cancel"];
    }
    if (state === "unusable") {
        return ["check", "Check again"];
    }
    if (state === "failed" || (state === "stopped" && result === null)) {
        return [`train-${effort}`, state === "failed" ? "Try again" : "Train"];
    }
    return [null, null];
}

function showShare(progress, share) {
    progress.hidden = share === undefined;
    setAttribute(progress, "value", typeof share === "number" ? String(share) : null);
}

function setText(element, text) {
    if (element.textContent !== text) {
        element.textContent = text;
    }
}

function setAttribute(element, name, value) {
    if (value === null) {
        element.removeAttribute(name);
    } else if (element.getAttribute(name) !== value) {
        element.setAttribute(name, value);
    }
}
