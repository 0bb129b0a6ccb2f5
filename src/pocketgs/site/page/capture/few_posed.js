/**
 * Captures of whose photographs most have no pose; see `few_posed` in `capture/unposed.py`.
 *
 * @module
 */

import { folderOf } from "../archive/tree.js";
import { isImage } from "./image_header.js";

/**
 * A warning if most images in the folders of those with a pose have none. Of captures that `pocketgs pose` made, it has
 * told which images it could not place.
 *
 * @param {(import("../archive/tree.js").StoredFile | undefined)[]} files the images with a pose
 * @param {(import("../archive/tree.js").StoredFile | null)[]} masks images that are masks
 * @param {import("../archive/tree.js").FileTree} tree
 * @param {{posed_record: string}} bounds the settings' `capture`
 * @param {string} where what states the poses, for the message
 * @returns {string[]} the warning, or none
 */
export function fewPosedWarning(files, masks, tree, { posed_record: record }, where) {
    if (tree.find(record)) {
        return [];
    }
    const posed = [...new Set(files.filter(Boolean).map(({ path }) => path))];
    const others = new Set(masks.filter(Boolean).map(({ path }) => path));
    const inFolders = [...new Set(posed.map(folderOf))].flatMap((folder) => tree.pathsIn(folder, isImage));
    const present = inFolders.filter((path) => !others.has(path)).length;
    const found = `only ${posed.length} of ${present} images have a pose in ${where}`;
    return 2 * posed.length < present ? [`${found}: let pocketgs pose find all anew`] : [];
}
