/**
 * The image files of a COLMAP model's registered images; the twin of `capture/formats/colmap_images.py`.
 *
 * @module
 */

import { fewPosedWarning } from "./few_posed.js";
import { isImage } from "./image_header.js";
import { pairByNumber } from "./last_numbers.js";
import { byCodePoint } from "./listing.js";
import { findImages, findStated, isRooted, lastPartOf } from "./named_images.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("../archive/tree.js").StoredFile} StoredFile
 * @typedef {[(StoredFile | undefined)[], string[]]} Files each registered image's file, undefined where it is missing,
 *     and warnings
 */

/**
 * Find the file of each registered image.
 *
 * @param {string[]} names of the registered images
 * @param {string} folder of the images; "" for the capture itself
 * @param {FileTree} tree
 * @param {string} where the file that states the names, for messages
 * @param {Object} bounds the settings' `capture`
 * @param {(folder: string) => boolean} leaveOut whether a search in the whole capture leaves out a folder
 * @returns {Files}
 * @throws {Error} a name is not usable, or no image is found
 */
export function matchFiles(names, folder, tree, where, bounds, leaveOut) {
    const [files, warnings] = namedFiles(names, folder, tree, where, bounds, leaveOut);
    const absent = names.filter((_, i) => !files[i]);
    if (absent.length === names.length) {
        return renamedFiles(names, folder, tree);
    }
    const found = `${absent.length} of ${names.length} registered images are absent, the first ${absent[0]}`;
    return [files, [...warnings, ...(absent.length ? [found] : []), ...fewPosedWarning(files, [], tree, bounds, "the COLMAP model")]];
}

/**
 * Whether a folder holds a registered image. Of absolute paths, which are another machine's, only names count.
 *
 * @type {(folder: string, names: string[], tree: FileTree, where: string) => boolean}
 * @throws {Error} a name leads out of the folder
 */
export function holdsAny(folder, names, tree, where) {
    const bare = names.map((name) => (isRooted(name) ? lastPartOf(name) : name));
    return findStated(tree, folder, bare, where).some(Boolean);
}

/** Each image's file in the folder, or else by its name alone. */
function namedFiles(names, folder, tree, where, bounds, leaveOut) {
    // Absolute paths are of the machine that wrote them: those images are found by name alone.
    const wereElsewhere = names.some(isRooted);
    const stated = wereElsewhere ? [] : findStated(tree, folder, names, where);
    if (stated.some(Boolean)) {
        return [stated, []];
    }
    // As with relative names, those of the folder beside the model come first: the originals have the same names.
    const below = names.map((name) => `${bounds.usual_images}/${name}`);
    const places = wereElsewhere && folder !== "" ? [folder, ""] : [""];
    const outcomes = places.map((place) => findImages(tree, place, below, where, [""], bounds, leaveOut));
    return outcomes.find(([files]) => files.some(Boolean)) ?? outcomes.at(-1);
}

/** The files of images whose smaller copies were renamed: `images/IMG_4026.JPG`, `images_8/image000.png`. */
function renamedFiles(names, folder, tree) {
    const present = tree.pathsIn(folder, isImage).sort(byCodePoint);
    if (present.length !== names.length) {
        throw new Error(`${folder || "."}: holds none of the ${names.length} registered images, such as ${names[0]}`);
    }
    const byNumber = pairByNumber(names, present);
    const ordered = names.toSorted(byCodePoint);
    const byName = byNumber.size ? byNumber : new Map(ordered.map((name, i) => [name, present[i]]));
    const how = byNumber.size ? "by the numbers in their names" : "in sorted order";
    const message = `${folder || "."} names its files otherwise: matched to the model ${how}`;
    return [names.map((name) => tree.find(byName.get(name))), [message]];
}
