/**
 * Choosing files, and what is wrong with them.
 *
 * @module
 */

import { element } from "../page/element.js";

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
    const input = element("files");
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
 * Why files cannot be uploaded, or "". The server would say the same, but only once they have a title.
 *
 * @param {File[]} files
 * @param {{ suffixes: Object<string, string[]>, bounds: Object }} shelf
 * @returns {string}
 */
export function problemWith(files, { suffixes, bounds }) {
    const [fewest, most] = bounds.photographs;
    const kindOf = ({ name }) => Object.keys(suffixes).find((kind) => suffixes[kind].includes(suffixOf(name)));
    const kinds = new Set(files.map(kindOf));
    const empty = files.find(({ size }) => size === 0);
    const other = files.find((file) => !kindOf(file));
    const total = files.reduce((sum, { size }) => sum + size, 0);
    if (files.length > most) {
        return `${grouped(files.length)} files, expected at most ${grouped(most)}`;
    }
    if (empty) {
        return `${empty.name} is empty`;
    }
    if (other) {
        return `${other.name} is no photograph, video or zip file`;
    }
    if (kinds.size > 1 || (files.length > 1 && !kinds.has("photographs"))) {
        return "expected photographs, or one video, or one zip file";
    }
    if (files.length < fewest && kinds.has("photographs")) {
        return `expected at least ${fewest} photographs; 30 or more are better`;
    }
    return total > bounds.bytes ? `${megabytes(total)} to upload, expected at most ${megabytes(bounds.bytes)}` : "";
}

const suffixOf = (name) => name.slice(Math.max(0, name.lastIndexOf("."))).toLowerCase();
const grouped = (number) => number.toLocaleString("en");
const megabytes = (count) => `${grouped(Math.floor(count / 1e6))} MB`;
