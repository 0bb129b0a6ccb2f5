/**
 * Reader of COLMAP captures: a sparse model and a folder of images; see `capture/formats/colmap.py`.
 *
 * @module
 */

import { cameraAt, rotationOf } from "./camera.js";
import * as binary from "./colmap_binary.js";
import * as text from "./colmap_text.js";
import { isImage } from "./image_header.js";
import { byCodePoint, listingOf, soundCloud, sourceOf } from "./listing.js";
import { findImages, findStated } from "./named_images.js";

/** @typedef {import("../archive/tree.js").FileTree} FileTree */

/** @type {(tree: FileTree, bounds: Object) => boolean} */
export const recognises = (tree, bounds) => modelFolder(tree, bounds) !== undefined;

/**
 * @param {FileTree} tree
 * @param {Object} bounds the settings' `capture`
 * @returns {Promise<import("./listing.js").Listing>}
 * @throws {Error} a file is malformed, a camera model is not supported, or no registered image exists
 */
export async function read(tree, bounds) {
    const folder = modelFolder(tree, bounds);
    const part = (name) => findPart(tree, folder, name);
    const [inCameras, cameraFile] = part("cameras");
    const [inImages, imageFile] = part("images");
    const cameras = await inCameras.readCameras(cameraFile, bounds.camera_models);
    const registered = await inImages.readImages(imageFile);
    if (!registered.length) {
        throw new Error(`${imageFile.path}: registers no image, expected at least one`);
    }
    const [files, warnings] = matchFiles(registered, tree, folder, imageFile.path, bounds);
    const frames = registered.flatMap((image, i) => {
        return files[i] ? [frameOf(image, files[i], cameras, imageFile, bounds)] : [];
    });
    const cloud = await readPoints(part("points3D"), bounds);
    return listingOf("colmap", frames, { cloud, warnings });
}

function modelFolder(tree, bounds) {
    return bounds.model_folders.find((folder) => ["cameras", "images"].every((name) => findPart(tree, folder, name)));
}

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

/** Each registered image's file, undefined where it is missing, and warnings. */
function matchFiles(registered, tree, model, where, bounds) {
    const folder = imageFolder(tree, model, bounds);
    const names = registered.map(({ name }) => name);
    const [files, warnings] = namedFiles(names, tree, folder, where, bounds);
    const absent = names.filter((_, i) => !files[i]);
    if (absent.length < names.length) {
        const found = `${absent.length} of ${names.length} registered images are absent, the first ${absent[0]}`;
        return [files, absent.length ? [...warnings, found] : warnings];
    }
    // Smaller copies are often renamed, but stay in order.
    const present = tree.pathsIn(folder, isImage);
    if (present.length !== names.length) {
        const found = `holds none of the ${names.length} registered images, such as ${absent[0]}`;
        throw new Error(`${folder || bounds.usual_images}: ${found}`);
    }
    const ordered = names.toSorted(byCodePoint);
    const renamed = present.toSorted(byCodePoint);
    const message = `${folder} names its files otherwise: matched to the model in sorted order`;
    return [names.map((name) => tree.find(renamed[ordered.indexOf(name)])), [message]];
}

/** Each image's file in the folder, or else by its name alone. */
function namedFiles(names, tree, folder, where, bounds) {
    // Absolute paths are of the machine that wrote them: those images are found by name alone.
    const wereElsewhere = names.some((name) => name.startsWith("/"));
    const stated = wereElsewhere ? [] : findStated(tree, folder, names, where);
    if (stated.some(Boolean)) {
        return [stated, []];
    }
    // As with relative names, those of the folder beside the model come first: the originals have the same names.
    const below = names.map((name) => `${bounds.usual_images}/${name}`);
    const places = wereElsewhere && folder !== "" ? [folder, ""] : [""];
    const outcomes = places.map((place) => findImages(tree, place, below, where, [""], bounds));
    return outcomes.find(([files]) => files.some(Boolean)) ?? outcomes.at(-1);
}

/** The first usual folder beside the model or in the capture, or "" for the capture itself. */
function imageFolder(tree, model, { image_folders: usual }) {
    // COLMAP writes undistorted images beside their model; the originals in the capture have the same names.
    const folders = [around(model), ""].flatMap((place) => usual.map((name) => place + name));
    return folders.find((name) => tree.hasFolder(name)) ?? "";
}

/** The path to a model's `sparse` or `sparse/0`: empty, or with a slash at its end. */
function around(model) {
    return model.replace(/\/0$/, "").replace(/[^/]*$/, "");
}

function frameOf(image, file, cameras, imageFile, bounds) {
    const where = `${imageFile.path}, image ${image.name}`;
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
