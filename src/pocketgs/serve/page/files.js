/**
 * Choosing files, and what is wrong with them.
 *
 * @module
 */

import { sizeOf } from "../page/size_text.js";

/** For phones, which offer the camera and the library for these. */
const KINDS = { photographs: "image/*", video: "video/*" };

/** What the browser offers. iPhones have no type for .r3d, and would not offer such files: any may be an archive. */
const offered = (kind, suffixes) => (kind in KINDS ? [KINDS[kind], ...suffixes[kind]].join(",") : "");

/**
 * Let the user choose files. Called by a click.
 *
 * @param {string} kind photographs, video or archive
 * @param {Object<string, string[]>} suffixes of each kind
 * @returns {Promise<File[]>} empty if none was chosen
 */
export function choose(kind, suffixes) {
    const input = document.getElementById("files");
    input.accept = offered(kind, suffixes);
    input.multiple = kind === "photographs";
    input.value = "";
    return new Promise((resolve) => {
        input.onchange = () => resolve([...input.files]);
        input.oncancel = () => resolve([]);
        input.click();
    });
}

/**
 * Why files cannot be uploaded, or "". The server checks it too.
 *
 * @param {File[]} files
 * @param {{ suffixes: Object<string, string[]>, bounds: Object }} shelf
 */
export function problemWith(files, { suffixes, bounds }) {
    const hasOneOf = ({ name }, some) => some.some((suffix) => name.toLowerCase().endsWith(suffix));
    const known = Object.values(suffixes).flat();
    const other = files.find((file) => !hasOneOf(file, known));
    if (other) {
        return `${other.name} is no photograph, video or zip file.`;
    }
    const total = files.reduce((sum, { size }) => sum + size, 0);
    if (total > bounds.bytes) {
        return `The computer takes at most ${sizeOf(bounds.bytes)} at once.`;
    }
    const [fewest, most] = bounds.photographs;
    const arePhotographs = files.every((file) => hasOneOf(file, suffixes.photographs));
    if (arePhotographs && files.length < fewest) {
        return `At least ${fewest} photos are needed; 30 or more are better.`;
    }
    return files.length > most ? `The computer takes at most ${most} photos at once.` : "";
}
