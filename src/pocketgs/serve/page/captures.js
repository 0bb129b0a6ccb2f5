/**
 * The list of captures. Titles and messages are text, never markup.
 *
 * @module
 */

import { element } from "../page/element.js";
import { keepFocusIn } from "./focus.js";
import { shareOf, stateOf } from "./words.js";

/** Shows captures, and says what is asked of them. */
export class CaptureList {
    #list = element("captures");
    #template = element("capture");
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
                item.card.remove();
                this.#items.delete(id);
            }
        }
        captures.forEach((capture, index) => {
            const item = this.#items.get(capture.id) ?? this.#add(capture.id);
            item.capture = capture;
            update(item.card, capture, isHere(capture.id), stays);
            if (this.#list.children[index] !== item.card) {
                this.#list.insertBefore(item.card, this.#list.children[index] ?? null);
            }
        });
        if (focused >= 0) {
            const card = this.#list.children[Math.min(focused, captures.length - 1)];
            // The menu's button, which does nothing by itself.
            keepFocusIn(card ?? element("choices"), card ? ".more" : "button");
        }
    }

    #add(id) {
        const card = this.#template.content.firstElementChild.cloneNode(true);
        const item = { card, capture: null };
        card.dataset.id = id;
        const act = card.querySelector(".act");
        act.addEventListener("click", () => this.#onAction(act.dataset.action, item.capture));
        card.querySelector(".more").addEventListener("click", () => this.#onAction("menu", item.capture));
        this.#items.set(id, item);
        return item;
    }
}

function update(card, capture, isHere, stays) {
    const part = (selector) => card.querySelector(selector);
    const { id, kind, state, title, message, thumbnail } = capture;
    card.dataset.state = state;
    setText(part("bdi"), title);
    setText(part(".state"), stateOf(capture, isHere));
    setText(part(".message"), message);
    part(".message").hidden = message === "";
    showShare(part("progress"), shareOf(capture));
    const picture = thumbnail === null ? null : `captures/${id}/thumbnail.jpg?${thumbnail}`;
    setAttribute(part("img"), "src", picture);
    setAttribute(part(".picture use"), "href", `#icon-${kind}`);
    const isOpen = capture.live || (capture.result !== null && state !== "training");
    for (const link of card.querySelectorAll("a")) {
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
function actionOf({ state, active, progress, effort, result, can_go_on: canGoOn }, isHere) {
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
        if (canGoOn) {
            return ["go-on", "Go on"];
        }
        return [`train-${effort}`, state === "failed" ? "Try again" : "Train"];
    }
    return [null, null];
}

function showShare(progress, share) {
    progress.hidden = share === undefined;
    setAttribute(progress, "value", typeof share === "number" ? String(share) : null);
}

function setText(part, text) {
    if (part.textContent !== text) {
        part.textContent = text;
    }
}

function setAttribute(part, name, value) {
    if (value === null) {
        part.removeAttribute(name);
    } else if (part.getAttribute(name) !== value) {
        part.setAttribute(name, value);
    }
}
