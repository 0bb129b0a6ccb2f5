/**
 * What was deleted, and can be put back for a week.
 *
 * @module
 */

import { element } from "../page/element.js";

const trash = element("trash");
let shown = "";

/** @type {(deleted: { id: string, title: string }[], onRestore: (id: string) => void) => void} */
export function showTrash(deleted, onRestore) {
    const now = JSON.stringify(deleted);
    if (now === shown) {
        return; // the user may be about to press one of its buttons
    }
    const hadFocus = trash.contains(document.activeElement);
    shown = now;
    trash.hidden = deleted.length === 0;
    trash.querySelector("summary").textContent = `Deleted (${deleted.length}), kept for a week`;
    trash.querySelector("ul").replaceChildren(...deleted.map((each) => line(each, onRestore)));
    if (hadFocus) {
        (trash.hidden ? document.querySelector("#choices button") : trash.querySelector("summary")).focus();
    }
}

function line({ id, title }, onRestore) {
    const item = document.createElement("li");
    const name = document.createElement("bdi");
    const button = document.createElement("button");
    name.textContent = title;
    button.className = "wide";
    button.textContent = "Put back";
    button.addEventListener("click", () => onRestore(id));
    item.append(name, button);
    return item;
}
