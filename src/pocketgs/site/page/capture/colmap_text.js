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

/** @type {(file: StoredFile, models: CameraModel[]) => Promise<Map<number, ColmapCamera>>} */
export async function readCameras(file, models) {
    const cameras = new Map();
    for (const [where, line] of content(await linesOf(file))) {
        const words = line.split(/\s+/);
        if (words.length < 4) {
            throw malformed(where, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS");
        }
        const model = models.find(({ name }) => name === words[1]);
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

/** Two lines each, the second of which lists points. @type {(file: StoredFile) => Promise<ColmapImage[]>} */
export async function readImages(file) {
    const images = [];
    const lines = (await linesOf(file))[Symbol.iterator]();
    for (const [where, line] of content(lines)) {
        const words = line.split(/\s+/);
        if (words.length < 10) {
            throw malformed(where, line, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
        }
        const [, ...values] = numbers(words.slice(0, 9), where);
        const name = /^(?:\S+\s+){9}(.*)$/.exec(line)[1];
        images.push({ name, cameraId: values[7], quaternion: values.slice(0, 4), translation: values.slice(4, 7) });
        lines.next();
    }
    return images;
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

function* content(lines) {
    // Not `for … of`, which would end an iterator that the caller also advances.
    const iterator = lines[Symbol.iterator]();
    for (let next = iterator.next(); !next.done; next = iterator.next()) {
        const [where, line] = next.value;
        if (line && !line.startsWith("#")) {
            yield [where, line];
        }
    }
}

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
