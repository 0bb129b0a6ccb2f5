/**
 * Reader of COLMAP's text models: cameras.txt, images.txt, points3D.txt; lines that begin with # are comments.
 *
 * @module
 */

import { cameraFrom, unknownModel } from "./colmap_model.js";

/**
 * @typedef {import("../archive/tree.js").StoredFile} StoredFile
 * @typedef {import("./colmap_model.js").CameraModel} CameraModel
 * @typedef {import("./colmap_model.js").ColmapCamera} ColmapCamera
 * @typedef {import("./colmap_model.js").ColmapImage} ColmapImage
 */

/**
 * @param {StoredFile} file
 * @param {{camera_models: CameraModel[]}} bounds
 * @param {Set<number>} used cameras that must be read; others are left out if their model is not supported
 * @returns {Promise<Map<number, ColmapCamera>>}
 */
export async function readCameras(file, { camera_models: models }, used) {
    const cameras = new Map();
    for (const [where, line] of content(await linesOf(file))) {
        const words = line.split(/\s+/);
        if (words.length < 4) {
            throw malformed(where, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS");
        }
        const model = models.find(({ name }) => name === words[1]);
        if (!model && !used.has(Number(words[0]))) {
            continue;
        }
        if (!model) {
            throw unknownModel(where, words[1], models);
        }
        const [id, width, height, ...values] = numbers([words[0], words[2], words[3], ...words.slice(4)], where);
        if (values.length !== model.parameters.length) {
            throw malformed(where, line, `${model.parameters.length} parameters for ${model.name}`);
        }
        cameras.set(id, cameraFrom(model, [width, height], values, where));
    }
    return cameras;
}

/** Two lines each, the second of which lists points; other programs leave it out. @type {(file: StoredFile) => Promise<ColmapImage[]>} */
export async function readImages(file) {
    const images = [];
    let isSecond = false;
    for (const [where, line] of await linesOf(file)) {
        if (isSecond && !isOfAnImage(line)) {
            isSecond = false;
            continue;
        }
        if (!isContent(line)) {
            continue;
        }
        const words = line.split(/\s+/);
        if (words.length < 10) {
            throw malformed(where, line, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
        }
        const [, ...values] = numbers(words.slice(0, 9), where);
        const name = /^(?:\S+\s+){9}(.*)$/.exec(line)[1];
        images.push({ name, cameraId: values[7], quaternion: values.slice(0, 4), translation: values.slice(4, 7) });
        isSecond = true;
    }
    return images;
}

/** Whether a line ends in a name, such as `20240100 120000.jpg`. One that lists points ends in numbers. */
function isOfAnImage(line) {
    const words = line.split(/\s+/);
    return words.length >= 10 && [words[9], words.at(-1)].some((word) => Number.isNaN(Number(word)));
}

/** @type {(file: StoredFile) => Promise<import("./listing.js").Cloud>} */
export async function readPoints(file) {
    const rows = [];
    for (const [where, line] of content(await linesOf(file))) {
        const words = line.split(/\s+/, 7);
        if (words.length < 7) {
            throw malformed(where, line, "POINT_ID X Y Z R G B ERROR TRACK");
        }
        rows.push(numbers(words.slice(1), where));
    }
    const positions = Float64Array.from(rows.flatMap((row) => row.slice(0, 3)));
    return { positions, colours: Float32Array.from(rows.flatMap((row) => row.slice(3).map((value) => value / 255))) };
}

/** Every line with its place, for messages. */
async function linesOf(file) {
    return (await file.text()).split("\n").map((line, i) => [`${file.path}, line ${i + 1}`, line.trim()]);
}

const content = (lines) => lines.filter(([, line]) => isContent(line));

const isContent = (line) => line && !line.startsWith("#");

function numbers(words, where) {
    return words.map((word) => {
        const value = Number(word);
        if (!Number.isFinite(value)) {
            throw new Error(`${where}: found ${word.slice(0, 40)}, expected numbers`);
        }
        return value;
    });
}

function malformed(where, line, expected) {
    return new Error(`${where}: found '${line.slice(0, 80)}', expected ${expected}`);
}
