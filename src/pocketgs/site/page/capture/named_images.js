/**
 * Finding the image files that a capture names, also when they have moved; the twin of `capture/named_images.py`.
 *
 * @module
 */

import { folderOf, nameOf, spelling } from "../archive/tree.js";
import { isImage } from "./image_header.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("../archive/tree.js").StoredFile} StoredFile
 */

/**
 * Find the file of each image that a capture names: at stated paths, by their names, or from the folders around.
 *
 * @param {FileTree} tree
 * @param {string} folder that the images lie in; "" for the whole capture
 * @param {string[]} named stated paths, relative to the folder
 * @param {string} where the file that states them, for messages
 * @param {string[]} suffixes to try at the end of each
 * @param {{deepest: number, other_pictures: string}} bounds the settings' `capture`
 * @param {(folder: string) => boolean} leaveOut whether the search by name leaves out a folder
 * @returns {[(StoredFile | undefined)[], string[]]} the files, undefined where missing, and warnings
 * @throws {Error} a path leaves the folder, unless all are of another machine and an image has the name of one
 */
export function findImages(tree, folder, named, where, suffixes, bounds, leaveOut = () => false) {
    let refusal = null;
    try {
        const stated = findStated(tree, folder, named, where, suffixes);
        if (stated.some(Boolean)) {
            return [stated, []];
        }
    } catch (error) {
        refusal = error;
    }
    const files = byNameAlone(imagesBelow(tree, folder, bounds, leaveOut), tree, named, suffixes);
    const found = files.filter(Boolean);
    const [fromAround, warnings] = found.length ? [[], []] : statedFromAround(tree, named, where, suffixes);
    if (fromAround.some(Boolean)) {
        return [fromAround, warnings];
    }
    const hasMoved = found.length > 0 && named.every(isRooted);
    if (refusal && !hasMoved && found.length < named.length) {
        throw refusal;
    }
    if (!found.length) {
        return [files, []];
    }
    const said = `no image is at its stated path; ${found.length} of ${named.length} were found by their names`;
    return [files, [`${where}: ${said}, such as ${found[0].path} for ${named[files.indexOf(found[0])]}`]];
}

/** The files at stated paths from the closest folder around the capture's that has one; and a warning. */
function statedFromAround(tree, named, where, suffixes) {
    for (const place of foldersAround(tree).slice(1)) {
        try {
            const files = findStated(tree, place, named, where, suffixes);
            if (files.some(Boolean)) {
                return [files, [`${where}: its paths are from the folder ${place}, and not from its own`]];
            }
        } catch {
            // Absolute paths, and such that lead out.
        }
    }
    return [[], []];
}

/** The capture's folder and those around it: "", `../`, `../../`. @type {(tree: FileTree) => string[]} */
const foldersAround = (tree) => Array.from({ length: tree.depth + 1 }, (_, i) => "../".repeat(i));

/**
 * The files that `findImages` finds in the stated folders. Case, the separator of folders, and the encoding of accents
 * may differ; so may the suffix, if no other image has the same stem, and none of the folder exists under that suffix.
 *
 * @type {(tree: FileTree, folder: string, named: string[], where: string, suffixes?: string[]) => (StoredFile | undefined)[]}
 * @throws {Error} a path leaves the folder
 */
export function findStated(tree, folder, named, where, suffixes = [""]) {
    const present = new Map();
    const stemsIn = (place) => present.get(place) ?? present.set(place, pathsByStem(tree, place)).get(place);
    const only = (paths) => (paths.length === 1 ? tree.find(paths[0]) : undefined);
    const sameStem = named.map((name) => {
        const path = tree.inside(folder, name, where);
        const file = suffixes.map((suffix) => tree.find(path + suffix)).find(Boolean);
        return file ? [file.path] : (stemsIn(folderOf(path)).get(stemOf(name)) ?? []);
    });
    const files = sameStem.map((paths, i) => only(ofTheName(paths, named[i], suffixes)));
    const [taken, unconverted] = [new Set(files.map((file) => file?.path)), kindsOf(named, files)];
    return files.map((file, i) => {
        return file ?? (unconverted.has(kindOf(named[i])) ? undefined : only(sameStem[i].filter((path) => !taken.has(path))));
    });
}

/** The paths that end in a stated name and one of the suffixes. */
function ofTheName(paths, stated, suffixes) {
    return paths.filter((path) => suffixes.some((suffix) => spelling(nameOf(path)) === spelling(lastPartOf(stated) + suffix)));
}

/** The kinds of images some of which exist under their names, and so were not converted: they all would be. */
const kindsOf = (named, found) => new Set(named.filter((_, i) => found[i]).map(kindOf));

/** The folder and the suffix of a stated path. */
function kindOf(stated) {
    return [...partsOf(spelling(stated)).slice(0, -1), spelling(lastPartOf(stated)).slice(stemOf(stated).length)].join("/");
}

/**
 * The file that a capture names: for an absolute path, by the longest end of it that exists. Absolute paths are of the
 * machine that wrote them.
 *
 * @param {FileTree} tree
 * @param {string} stated relative to the capture, or absolute
 * @param {string} where the file that states it, for messages
 * @param {{deepest: number}} bounds the settings' `capture`
 * @param {StoredFile | null} photograph whose mask or depth is sought, which often has its name
 * @returns {StoredFile | undefined}
 * @throws {Error} the path leaves the capture
 */
export function findMoved(tree, stated, where, { deepest }, photograph = null) {
    if (!isRooted(stated)) {
        const path = tree.inside("", stated, where);
        return foldersAround(tree).map((place) => tree.find(place + path)).find(Boolean);
    }
    const parts = partsOf(stated.replace(/^[a-z]:/i, "")).slice(-deepest - 1);
    const ends = parts.map((_, start) => parts.slice(start).join("/"));
    const files = ends.flatMap((end) => foldersAround(tree).map((place) => tree.find(place + end)));
    return files.find((file) => file && file.path !== photograph?.path);
}

/** Whether a path begins at the root of a disk, as on any system. @type {(path: string) => boolean} */
export const isRooted = (path) => /^([a-z]:)?[/\\]/i.test(path);

/** File name of a path with either separator. @type {(path: string) => string} */
export const lastPartOf = (path) => partsOf(path).at(-1) ?? "";

/** Name without suffix, and without what differs between systems. @type {(path: string) => string} */
export const stemOf = (path) => spelling(lastPartOf(path)).replace(/(?<=.)\.[^.]*$/, "");

/** For each image, the present file of its name whose folders agree best with the stated ones; undefined on a tie. */
function byNameAlone(present, tree, named, suffixes) {
    const byName = grouped(present, (path) => spelling(nameOf(path)));
    const byStem = grouped(present, stemOf);
    const own = named.map((name) => suffixes.flatMap((suffix) => byName.get(spelling(lastPartOf(name) + suffix)) ?? []));
    const unconverted = kindsOf(named, own.map((paths) => paths.length));
    return named.map((name, i) => {
        const paths = unconverted.has(kindOf(name)) ? own[i] : (byStem.get(stemOf(name)) ?? []);
        const ranked = paths.map((path) => ({ path, rank: rankOf(path, name) })).sort((a, b) => b.rank - a.rank);
        const isUnique = ranked.length === 1 || ranked[0]?.rank > ranked[1]?.rank;
        return isUnique ? tree.find(ranked[0].path) : undefined;
    });
}

/** The number of parts that agree from the end counts first, and then full resolution. The highest rank is best. */
function rankOf(path, stated) {
    const [own, other] = [path, stated].map((one) => partsOf(spelling(one)).reverse());
    // The suffix of the name may have been added.
    const differing = own.findIndex((part, i) => i > 0 && part !== other[i]);
    const agreeing = differing < 0 ? own.length : differing;
    return 2 * agreeing - (/_\d+$/.test(folderOf(path)) ? 1 : 0);
}

/** Paths of all images below a folder, except in folders of masks, depths and the like. */
function imagesBelow(tree, folder, { deepest, other_pictures: beginning }, leaveOut) {
    const others = new RegExp(`^(?:${beginning})`);
    const isOther = (place) => others.test(nameOf(place).toLowerCase());
    const first = folder === "" ? "" : `${folder}/`;
    const byFolder = grouped(tree.paths.filter((path) => path.startsWith(first) && isImage(path)), folderOf);
    const searched = [...byFolder.keys()].filter((place) => {
        const parts = partsOf(place.slice(first.length));
        const onTheWay = parts.map((_, i) => first + parts.slice(0, i + 1).join("/"));
        return parts.length <= deepest && !onTheWay.some((one) => isOther(one) || leaveOut(one));
    });
    return searched.flatMap((place) => byFolder.get(place));
}

function pathsByStem(tree, folder) {
    return grouped(tree.pathsIn(folder, isImage), stemOf);
}

/** A path's parts, with either separator: paths may come from Windows. @type {(path: string) => string[]} */
const partsOf = (path) => path.split(/[/\\]/).filter(Boolean);

/** @type {(paths: string[], keyOf: (path: string) => string) => Map<string, string[]>} */
function grouped(paths, keyOf) {
    const groups = new Map();
    for (const path of paths) {
        groups.has(keyOf(path)) || groups.set(keyOf(path), []);
        groups.get(keyOf(path)).push(path);
    }
    return groups;
}
