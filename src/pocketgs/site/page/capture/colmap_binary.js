/**
 * Reader of COLMAP's binary models: cameras.bin, images.bin, points3D.bin (little-endian, counts first).
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

const CAMERA_BYTES = 24;
const IMAGE_BYTES = 64;
const POINT_2D_BYTES = 24;
const POINT_BYTES = 51;
const TRACK_ELEMENT_BYTES = 8;

/** Reads a file's numbers in order. */
class Cursor {
    #view;
    #bytes;
    #at = 0;

    constructor(bytes, path) {
        this.path = path;
        this.#bytes = bytes;
        this.#view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    }

    /** Pass over bytes; returns where they begin. */
    skip(bytes) {
        const start = this.#at;
        if (start + bytes > this.#bytes.length) {
            const where = `ends after ${this.#bytes.length} bytes, in the middle of an item`;
            throw new Error(`${this.path}: ${where}: was it copied as a whole?`);
        }
        this.#at = start + bytes;
        return start;
    }

    word = () => this.#view.getUint32(this.skip(4), true);
    byte = () => this.#bytes[this.skip(1)];
    long = () => Number(this.#view.getBigUint64(this.skip(8), true));
    doubles = (count) => Array.from({ length: count }, () => this.#view.getFloat64(this.skip(8), true));

    /** A count of items that the rest of the file can hold. */
    count(smallest) {
        const count = this.long();
        if (count > (this.#bytes.length - this.#at) / smallest) {
            const held = `more than its ${this.#bytes.length} bytes can hold`;
            throw new Error(`${this.path}: states ${count} items, ${held}: was it copied as a whole?`);
        }
        return count;
    }

    /** Text up to a zero. */
    text() {
        const end = this.#bytes.indexOf(0, this.#at);
        const start = this.skip((end < 0 ? this.#bytes.length : end) + 1 - this.#at);
        return new TextDecoder().decode(this.#bytes.subarray(start, end));
    }
}

/**
 * @param {StoredFile} file
 * @param {{camera_models: CameraModel[], unsupported_models: {number: number, parameters: number}[]}} bounds
 * @param {Set<number>} used cameras that must be read; others are left out if their model is not supported
 * @returns {Promise<Map<number, ColmapCamera>>}
 */
export async function readCameras(file, { camera_models: models, unsupported_models: unsupported }, used) {
    const cursor = new Cursor(await file.bytes(), file.path);
    const cameras = new Map();
    for (let left = cursor.count(CAMERA_BYTES); left > 0; left--) {
        const [id, number] = [cursor.word(), cursor.word()];
        const size = [cursor.long(), cursor.long()];
        const where = `${file.path}, camera ${id}`;
        const model = models.find((one) => one.number === number);
        const other = unsupported.find((one) => one.number === number);
        if (!model && other && !used.has(id)) {
            cursor.doubles(other.parameters);
            continue;
        }
        if (!model) {
            throw unknownModel(where, `number ${number}`, models);
        }
        cameras.set(id, cameraFrom(model, size, cursor.doubles(model.parameters.length), where));
    }
    return cameras;
}

/** @type {(file: StoredFile) => Promise<ColmapImage[]>} */
export async function readImages(file) {
    const cursor = new Cursor(await file.bytes(), file.path);
    return Array.from({ length: cursor.count(IMAGE_BYTES + 9) }, () => {
        cursor.word();
        const [quaternion, translation] = [cursor.doubles(4), cursor.doubles(3)];
        const cameraId = cursor.word();
        const name = cursor.text();
        cursor.skip(cursor.count(POINT_2D_BYTES) * POINT_2D_BYTES);
        return { name, cameraId, quaternion, translation };
    });
}

/** @type {(file: StoredFile) => Promise<import("./listing.js").Cloud>} */
export async function readPoints(file) {
    const cursor = new Cursor(await file.bytes(), file.path);
    const count = cursor.count(POINT_BYTES);
    const [positions, colours] = [new Float64Array(3 * count), new Float32Array(3 * count)];
    for (let i = 0; i < count; i++) {
        cursor.skip(8);
        positions.set(cursor.doubles(3), 3 * i);
        colours.set([cursor.byte() / 255, cursor.byte() / 255, cursor.byte() / 255], 3 * i);
        cursor.skip(8);
        cursor.skip(cursor.count(TRACK_ELEMENT_BYTES) * TRACK_ELEMENT_BYTES);
    }
    return { positions, colours };
}
