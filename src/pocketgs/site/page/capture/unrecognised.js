/**
 * What to say of files that are no capture; see `capture/unrecognised.py`.
 *
 * @module
 */

import { nameOf } from "../archive/tree.js";
import { isImage } from "./image_header.js";

const FORMATS = "transforms.json (nerfstudio), transforms_train.json (Blender), COLMAP's sparse/0";
const APPS = "Polycam, Record3D, Stray Scanner, 3D Scanner App or NeRFCapture";

/** Whether a file is a recording of Record3D, by its name. @type {(name: string) => boolean} */
export const isRecording = (name) => /\.r3d$/i.test(name);

/** @type {(tree: import("../archive/tree.js").FileTree) => string} */
export function unrecognised({ paths }) {
    const found = `not a capture of a format that this page reads${whatIsThere(paths)}`;
    return `${found}: expected ${FORMATS}, or data of ${APPS}`;
}

function whatIsThere(paths) {
    const archive = paths.find((path) => /\.(zip|7z|rar|tar|t?gz)$/i.test(path));
    if (archive) {
        return ` (it holds ${nameOf(archive)}: choose that alone, or unpack it first)`;
    }
    const [photographs, videos] = [paths.filter(isImage), paths.filter((path) => /\.(mp4|mov|m4v)$/i.test(path))];
    const kind = photographs.length ? "photographs" : "a video";
    const hasSome = photographs.length + videos.length > 0;
    return hasSome ? ` (it holds ${kind} without camera poses, which \`pocketgs train\` finds)` : "";
}
