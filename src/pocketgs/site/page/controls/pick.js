/**
 * What the user drops on the page, or chooses: a zip file, which .r3d files are too, or a folder.
 *
 * @module
 */

import { listenForDrops } from "../../page/controls/dropping.js";
import { element } from "../../page/element.js";

/** @typedef {import("../worker.js").Picked} Picked */

/**
 * Listen for captures.
 *
 * @param {(picked: Picked) => void} onPicked
 * @param {(text: string) => void} onFault called when what is dropped cannot be read
 */
export function listenForCaptures(onPicked, onFault) {
    listenForDrops((transfer) => {
        filesOf(transfer).then(
            (found) => pick(found, onPicked),
            ({ message }) => onFault(`What was dropped cannot be read: ${message}`),
        );
    });
    // Any file can be chosen: iPhones have no type for .r3d, and would not offer such files.
    for (const kind of ["archive", "folder"]) {
        const input = element(`${kind}-input`);
        element(`choose-${kind}`).addEventListener("click", () => input.click());
        input.addEventListener("change", () => {
            pick([...input.files].map(asFound), onPicked);
            input.value = "";
        });
    }
}

/** A lone file counts as an archive: what is none is refused when it is read. */
function pick(found, onPicked) {
    if (found.length === 1) {
        onPicked({ name: found[0].file.name.replace(/\.(zip|r3d)$/i, ""), archive: found[0].file, files: [] });
    } else if (found.length) {
        onPicked({ name: found[0].path.split("/")[0], archive: null, files: found });
    }
}

async function filesOf(transfer) {
    // Both before the first wait: afterwards the browser has emptied the transfer.
    const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
    const files = [...transfer.files];
    return entries.some(({ isDirectory }) => isDirectory) ? filesBelow(entries) : files.map(asFound);
}

const asFound = (file) => ({ path: file.webkitRelativePath || file.name, file });

/** All files below dropped folders. */
async function filesBelow(entries) {
    const found = [];
    for (const waiting = [...entries]; waiting.length; ) {
        const entry = waiting.pop();
        if (entry.isDirectory) {
            waiting.push(...(await entriesOf(entry)));
        } else {
            const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
            found.push({ path: entry.fullPath.replace(/^\//, ""), file });
        }
    }
    return found;
}

/** Browsers give a folder's entries a hundred at a time, and at last none. */
async function entriesOf(folder) {
    const reader = folder.createReader();
    const all = [];
    for (;;) {
        const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
        if (!some.length) {
            return all;
        }
        all.push(...some);
    }
}
