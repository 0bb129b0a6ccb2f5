/**
 * Opening a scene from the user's disk: dropped on the page, or chosen.
 *
 * @module
 */

import { element } from "../element.js";
import { listenForDrops } from "./dropping.js";

/**
 * Listen for files.
 *
 * @param {(file: File) => void} onFile
 */
export function listenForFiles(onFile) {
    // Any file can be chosen: iPhones have no type for .pgs or .spz, and would not offer such files.
    const input = element("file");
    const takeFirst = (files) => files?.length && onFile(files[0]);
    listenForDrops((transfer) => takeFirst(transfer?.files));
    input.addEventListener("change", () => {
        takeFirst(input.files);
        input.value = "";
    });
    element("open").addEventListener("click", () => input.click());
}
