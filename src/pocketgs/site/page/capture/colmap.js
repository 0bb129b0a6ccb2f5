/**
 * Reader of COLMAP captures: a sparse model and a folder of images; see `capture/formats/colmap.py`.
 *
 * @module
 */

import { folderOf, normalised } from "../archive/tree.js";
import { cameraAt, rotationOf } from "./camera.js";
import * as binary from "./colmap_binary.js";
import { holdsAny, matchFiles } from "./colmap_images.js";
import * as text from "./colmap_text.js";
import { listingOf, soundCloud, sourceOf } from "./listing.js";

/** @typedef {import("../archive/tree.js").FileTree} FileTree */

/**
 * @typedef {Object} Model a sparse model
 * @property {string} folder
 * @property {import("./colmap_model.js").ColmapImage[]} images those that it registers
 * @property {string[]} warnings about its choice
 */

/** @type {(tree: FileTree, bounds: Object) => boolean} */
export const recognises = (tree, { model_folders: places }) => places.some((place) => modelsAt(tree, place).length > 0);

/**
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} a file is malformed, a camera model is not supported, or no registered image exists
 */
export async function read(tree, bounds) {
    const model = await chosenModel(tree, bounds);
    const where = model.folder || ".";
    const [reader, cameraFile] = findPart(tree, model.folder, "cameras");
    const cameras = await reader.readCameras(cameraFile, bounds, new Set(model.images.map(({ cameraId }) => cameraId)));
    if (!model.images.length) {
        throw new Error(`${where}: registers no image, expected at least one`);
    }
    const folder = imageFolder(tree, model.folder, bounds);
    const isOfAnother = (place) => isOfAnotherModel(place, tree, model.folder, bounds);
    const [files, warnings] = matchFiles(namesIn(model), folder, tree, `${where}: images`, bounds, isOfAnother);
    const frames = model.images.flatMap((image, i) => {
        return files[i] ? [frameOf(image, files[i], cameras, `${where}, image ${image.name}`, bounds)] : [];
    });
    const cloud = await readPoints(findPart(tree, model.folder, "points3D"), bounds);
    return listingOf("colmap", frames, { cloud, warnings: [...model.warnings, ...warnings] });
}

/**
 * The first model whose own image folder holds its images, or else the first: COLMAP writes undistorted images beside a
 * model of their own, and the originals may be elsewhere.
 */
async function chosenModel(tree, bounds) {
    let first = null;
    for (const folders of bounds.model_folders.map((place) => modelsAt(tree, place)).filter(({ length }) => length)) {
        const model = await largest(folders, tree);
        if (hasImages(model, tree, bounds)) {
            return model;
        }
        first ??= model;
    }
    return first;
}

/** Folders of the complete models at a usual place: where its name holds a 0, all that COLMAP numbers like it. */
function modelsAt(tree, place) {
    const numbered = new RegExp(`^${place.replace("0", "([0-9]{1,9})")}/`, "i");
    const numbers = tree.paths.flatMap((path) => numbered.exec(path)?.[1] ?? []).map(Number);
    const sorted = [...new Set(numbers)].sort((a, b) => a - b);
    const folders = place.includes("0") ? sorted.map((number) => place.replace("0", number)) : [place];
    return folders.filter((folder) => ["cameras", "images"].every((name) => findPart(tree, folder, name)));
}

/** Of several models, whose worlds have nothing in common, the one with the most registered images. */
async function largest(folders, tree) {
    const models = [];
    for (const folder of folders) {
        const [reader, file] = findPart(tree, folder, "images");
        models.push({ folder, images: await reader.readImages(file), warnings: [] });
    }
    const most = Math.max(...models.map(({ images }) => images.length));
    const model = models.find(({ images }) => images.length === most);
    if (models.length === 1) {
        return model;
    }
    const sizeOf = ({ folder, images }) => `${folder} with ${images.length}`;
    const found = `${models.length} COLMAP models that do not fit together: ${models.map(sizeOf).join(", ")} images`;
    return { ...model, warnings: [`${found}; only the largest, ${sizeOf(model)}, is used`] };
}

/** Whether the first usual folder beside a model holds its images. */
function hasImages(model, tree, { image_folders: usual }) {
    const beside = usual.map((name) => around(model.folder) + name).find((folder) => tree.hasFolder(folder));
    return beside !== undefined && holdsAny(beside, namesIn(model), tree, model.folder || ".");
}

/** Whether a folder lies beside another model. */
function isOfAnotherModel(place, tree, model, { models_beside: places }) {
    const parent = folderOf(place);
    const isOther = normalised(around(model)) !== parent;
    return isOther && places.some((beside) => modelsAt(tree.below(parent), beside).length > 0);
}

const namesIn = ({ images }) => images.map(({ name }) => name);

/** A part's reader and file, the binary one if both exist. */
function findPart(tree, folder, name) {
    for (const [reader, suffix] of [[binary, ".bin"], [text, ".txt"]]) {
        const file = tree.find(`${folder}/${name}${suffix}`);
        if (file) {
            return [reader, file];
        }
    }
    return undefined;
}

/** The first usual folder beside the model or in the capture, or "" for the capture itself. */
function imageFolder(tree, model, { image_folders: usual }) {
    // COLMAP writes undistorted images beside their model; the originals in the capture have the same names.
    const folders = [around(model), ""].flatMap((place) => usual.map((name) => place + name));
    return folders.find((name) => tree.hasFolder(name)) ?? "";
}

/** The path to a model's `sparse` or `sparse/0`: empty, or with a slash at its end. */
function around(model) {
    return model.replace(/\/[0-9]+$/, "").replace(/[^/]*$/, "");
}

function frameOf(image, file, cameras, where, bounds) {
    const camera = cameras.get(image.cameraId);
    if (!camera) {
        throw new Error(`${where}: taken by camera ${image.cameraId}, which the model does not have`);
    }
    const rotation = rotationOf(where, image.quaternion);
    const posed = cameraAt(where, camera, rotation, image.translation, bounds);
    return sourceOf(file, posed, { lens: camera.lens });
}

async function readPoints(part, bounds) {
    if (!part) {
        return null;
    }
    const [reader, file] = part;
    return soundCloud(await reader.readPoints(file), file, bounds);
}
