/**
 * Masks of photographs: which image belongs to which photograph, in the layouts that other programs write, and which
 * pixels it says are to be used; see `capture/masks.py` and `capture/decoding/mask_file.py`.
 *
 * @module
 */

import { folderOf, nameOf, normalised } from "../archive/tree.js";
import { isImage, storedSize } from "./image_header.js";
import { pairByNumber } from "./last_numbers.js";
import { decodedAsStored } from "./pixels.js";

/**
 * @typedef {import("../archive/tree.js").FileTree} FileTree
 * @typedef {import("./listing.js").Listing} Listing
 */

/** Grey counts from half of white upwards, since edges are often smoothed. */
const HALF = 127;

/**
 * Add a mask to each frame of a capture that has one, unless the capture states masks itself.
 *
 * @param {Listing} listing
 * @param {FileTree} tree
 * @param {{mask_folders: string[]}} bounds the settings' `capture`
 * @returns {Promise<Listing>}
 */
export async function withMasks(listing, tree, { mask_folders: usual }) {
    if (listing.frames.some(({ mask }) => mask)) {
        return listing;
    }
    const names = listing.frames.map(({ name }) => name);
    const warnings = [...listing.warnings];
    for (const folder of foldersOfMasks(names, tree, usual)) {
        const [found, mismatch] = matched(names, folder, tree);
        const isBeside = names.some((name) => folderOf(folderOf(name)) === folderOf(folder));
        const reason = mismatch ?? (isBeside ? null : await otherShape(listing.frames, found));
        if (!reason) {
            const lacking = names.filter((name) => !found.has(name));
            if (lacking.length) {
                const count = `${lacking.length} of ${names.length} frames`;
                warnings.push(`${folder}: no masks for ${count}, which are used whole, the first ${lacking[0]}`);
            }
            const frames = listing.frames.map((frame) => ({ ...frame, mask: found.get(frame.name) ?? null, isMaskFound: true }));
            return { ...listing, frames, warnings };
        }
        warnings.push(`${folder}: ${reason}; these masks are not used`);
    }
    return { ...listing, warnings };
}

/**
 * Which pixels a mask says are to be used.
 *
 * @param {import("../archive/tree.js").StoredFile} file
 * @returns {Promise<{width: number, height: number, used: Uint8ClampedArray}>} 255 for those, else 0
 * @throws {Error} it cannot be decoded
 */
export async function readMask(file) {
    const pixels = await decodedAsStored(file);
    const { rgba } = pixels;
    const alpha = new Uint8ClampedArray(rgba.length / 4).map((_, i) => rgba[4 * i + 3]);
    // Of a colour its brightest channel counts.
    const values = alpha.map((_, i) => Math.max(rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]));
    const most = values.reduce((most, value) => Math.max(most, value), 0);
    // Canvases lose the colours of transparent pixels.
    const opaque = values.filter((_, i) => alpha[i] === 255);
    const isCutOut = opaque.length < values.length && opaque.every((value) => value === opaque[0]);
    // Of a cut-out in one colour its alpha says all. Masks of zeros and ones are known by their maximum, and in a
    // palette everything but black counts.
    const least = isCutOut ? -1 : most <= 1 || isPalette(await file.start(26)) ? 0 : HALF;
    const used = values.map((value, i) => (value > least && alpha[i] > HALF ? 255 : 0));
    return { width: pixels.width, height: pixels.height, used };
}

/** Whether a PNG's header states indexed colours. */
function isPalette(start) {
    return start[0] === 0x89 && start[25] === 3;
}

/**
 * Beside the photographs' folder, whatever its name, or else in the capture; for `images_2` there may be `masks_2`.
 * The masks in a capture may be of the originals, where undistorted copies in another folder are used.
 */
function foldersOfMasks(names, tree, usual) {
    const folders = [...new Set(names.map(folderOf))];
    const sizes = [...new Set(folders.flatMap((folder) => /_\d+$/.exec(nameOf(folder))?.[0] ?? []))].sort();
    const parents = new Set(folders.map(folderOf));
    const places = [...[...parents].sort(), ""];
    const candidates = places.flatMap((place) => {
        return [...sizes, ""].flatMap((size) => usual.map((name) => normalised(`${place}/${name}${size}`)));
    });
    return [...new Set(candidates)].filter((folder) => tree.hasFolder(folder));
}

/** Why masks are of other photographs, such as those not undistorted: one is no scaled copy of its own. Else null. */
async function otherShape(frames, masks) {
    for (const { name, camera } of frames.filter(({ name }) => masks.has(name))) {
        const mask = masks.get(name);
        try {
            const [width, height] = await storedSize(mask);
            if (Math.abs((width * camera.height) / camera.width - height) > 1) {
                const found = `${mask.path} is a mask of ${width}x${height} pixels`;
                const expected = `expected the shape of ${name}, ${camera.width}x${camera.height}`;
                return `${found}, ${expected}: it may be of the photograph before undistortion`;
            }
        } catch (error) {
            return error.message;
        }
    }
    return null;
}

/** The masks by their photographs, and why they cannot be used, if so. */
function matched(names, folder, tree) {
    const files = tree.pathsBelow(folder).filter(isImage).sort();
    const byName = new Map();
    for (const path of files) {
        const name = path.slice(folder.length + 1).toLowerCase();
        for (const key of [name, withoutSuffix(name)]) {
            byName.has(key) || byName.set(key, path);
        }
    }
    const named = new Map(names.map((name) => [name, namedAs(name, byName)]).filter(([, path]) => path));
    const found = named.size ? named : pairByNumber(names, files);
    if (!found.size) {
        return [found, `none of its ${files.length} images is the mask of a frame`];
    }
    const paths = [...found.values()];
    const shared = paths.find((path, i) => paths.indexOf(path) !== i);
    if (shared !== undefined) {
        return [found, `${shared} fits several frames`];
    }
    return [new Map([...found].map(([name, path]) => [name, tree.find(path)])), null];
}

/** The mask of a photograph by its path, or by the longest end of its path. */
function namedAs(photograph, byName) {
    const parts = photograph.toLowerCase().split("/");
    for (let start = 0; start < parts.length; start++) {
        const name = parts.slice(start).join("/");
        // A mask's name without its last suffix counts as well: NAME.jpg.png is found as NAME.jpg.
        const found = byName.get(name) ?? byName.get(withoutSuffix(name));
        if (found !== undefined) {
            return found;
        }
    }
    return undefined;
}

function withoutSuffix(name) {
    return name.replace(/(?<=[^/])\.[^./]+$/, "");
}
