/**
 * Images as arrays of RGBA: decoded by the browser, composited, made smaller; see `capture/loading.py`.
 *
 * @module
 */

import { readingFault } from "../archive/reading_fault.js";
import { areaAveraged } from "../numbers/resizing.js";
import { roundedToEven } from "../numbers/rounding.js";
import { DamagedImageError, readHeader } from "./image_header.js";

/**
 * @typedef {import("../numbers/resizing.js").Size} Size
 *
 * @typedef {Object} Pixels
 * @property {number} width
 * @property {number} height
 * @property {Uint8ClampedArray} rgba (H, W, 4), alpha not multiplied in
 */

/** Pixels that are drawn at once: Safari on iOS refuses canvases of more than 16.7 million. */
const MOST_DRAWN = 1 << 22;

/** One for all images, whose memory is given back after each: browsers free canvases late. */
const CANVAS = new OffscreenCanvas(0, 0);

/**
 * Decode an image.
 *
 * @param {Uint8Array} bytes what `readHeader` gives: browsers turn images and change colours as these say
 * @param {string} type such as image/png
 * @param {string} path for messages
 * @returns {Promise<Pixels>}
 * @throws {DamagedImageError} the browser cannot decode it
 * @throws {Error} it cannot be read
 */
export async function decoded(bytes, type, path) {
    const options = { premultiplyAlpha: "none" };
    let bitmap;
    try {
        bitmap = await createImageBitmap(new Blob([bytes], { type }), options);
        return drawn(bitmap, bitmap.width, bitmap.height);
    } catch (error) {
        const reason = readingFault(error);
        if (reason) {
            throw new Error(`${path} ${reason}`);
        }
        throw new DamagedImageError(`${path}: cannot be decoded, expected a whole image`);
    } finally {
        bitmap?.close();
    }
}

/**
 * Decode an image file as it is stored: without turning it, and without changing its colours.
 *
 * @param {import("../archive/tree.js").StoredFile} file
 * @returns {Promise<Pixels>}
 * @throws {Error} it cannot be read, or the browser cannot decode it
 */
export async function decodedAsStored(file) {
    const { type, plain } = readHeader(await file.bytes(), file.path);
    return decoded(plain, type, file.path);
}

/**
 * The pixels of what can be drawn on a canvas.
 *
 * @param {ImageBitmap | VideoFrame} image
 * @param {number} width
 * @param {number} height
 * @returns {Pixels}
 */
export function drawn(image, width, height) {
    const rgba = new Uint8ClampedArray(4 * width * height);
    // A frame of a video may be stated to be shown in another size.
    const [across, down] = [image.displayWidth ?? image.width, image.displayHeight ?? image.height];
    const most = Math.max(1, Math.min(height, Math.floor(MOST_DRAWN / width)));
    [CANVAS.width, CANVAS.height] = [width, most];
    const context = CANVAS.getContext("2d", { willReadFrequently: true });
    for (let top = 0; top < height; top += most) {
        const rows = Math.min(most, height - top);
        context.clearRect(0, 0, width, rows);
        context.drawImage(image, 0, (top * down) / height, across, (rows * down) / height, 0, 0, width, rows);
        rgba.set(context.getImageData(0, 0, width, rows).data, 4 * width * top);
    }
    CANVAS.width = CANVAS.height = 0;
    return { width, height, rgba };
}

/** Cut off a border. @type {(pixels: Pixels, border: number) => Pixels} */
export function withoutBorder({ width, height, rgba }, border) {
    const [across, down] = [width - 2 * border, height - 2 * border];
    return { width: across, height: down, rgba: planeWithoutBorder(rgba, width, height, border, 4) };
}

/**
 * Cut off a border of an array.
 *
 * @template {Uint8ClampedArray | Float32Array} Plane
 * @param {Plane} values (H, W, channels)
 * @param {number} width
 * @param {number} height
 * @param {number} border at each side
 * @param {number} channels
 * @returns {Plane}
 */
export function planeWithoutBorder(values, width, height, border, channels) {
    const [across, down] = [width - 2 * border, height - 2 * border];
    const inner = new values.constructor(channels * across * down);
    for (let row = 0; row < down; row++) {
        const begin = channels * ((row + border) * width + border);
        inner.set(values.subarray(begin, begin + channels * across), channels * row * across);
    }
    return inner;
}

/**
 * An array in another size, of each pixel what lies at its centre.
 *
 * @template {Uint8ClampedArray | Float32Array} Plane
 * @param {Plane} values (H, W)
 * @param {Size} before
 * @param {Size} after
 * @returns {Plane} the values themselves if the size stays
 */
export function nearestPlane(values, before, after) {
    if (before.width === after.width && before.height === after.height) {
        return values;
    }
    const found = new values.constructor(after.width * after.height);
    for (let row = 0; row < after.height; row++) {
        const begin = before.width * Math.floor((row + 0.5) * (before.height / after.height));
        for (let column = 0; column < after.width; column++) {
            const place = Math.floor((column + 0.5) * (before.width / after.width));
            found[row * after.width + column] = values[begin + place];
        }
    }
    return found;
}

/** Grey by the weights of ITU-R BT.601, as Pillow converts to "L". @type {(pixels: Pixels) => Uint8ClampedArray} */
export function greyOf({ rgba }) {
    const grey = new Uint8ClampedArray(rgba.length / 4);
    for (let i = 0; i < grey.length; i++) {
        grey[i] = 0.299 * rgba[4 * i] + 0.587 * rgba[4 * i + 1] + 0.114 * rgba[4 * i + 2];
    }
    return grey;
}

/** Whether any pixel is not opaque. @type {(pixels: Pixels) => boolean} */
export function hasAlpha({ rgba }) {
    for (let i = 3; i < rgba.length; i += 4) {
        if (rgba[i] < 255) {
            return true;
        }
    }
    return false;
}

/**
 * Composite colours on a background. Alpha stays.
 *
 * @param {Pixels} pixels changed in place
 * @param {number[]} background RGB in [0, 1]
 */
export function composite({ rgba }, background) {
    const behind = background.map((value) => 255 * value);
    for (let i = 0; i < rgba.length; i += 4) {
        const alpha = rgba[i + 3] / 255;
        for (let channel = 0; channel < 3; channel++) {
            const blend = (rgba[i + channel] - behind[channel]) * alpha + behind[channel];
            rgba[i + channel] = Math.floor(blend + 0.5);
        }
    }
}

/**
 * The size of an image that is at most so many pixels long.
 *
 * @param {Size} size
 * @param {number} most pixels of the longer side
 * @returns {Size}
 */
export function sizeWithin({ width, height }, most) {
    const longer = Math.max(width, height);
    if (longer <= most) {
        return { width, height };
    }
    const [across, down] = [width, height].map((side) => Math.max(1, roundedToEven((side * most) / longer)));
    return { width: across, height: down };
}

/**
 * Make an array smaller, averaging areas. Halves are rounded as by OpenCV: up where both sides are halved, otherwise to
 * even numbers.
 *
 * @param {Uint8ClampedArray} values (H, W, channels)
 * @param {number} channels
 * @param {Size} before
 * @param {Size} after not more
 * @returns {Uint8ClampedArray} the values themselves if the size stays
 */
export function averagedPlane(values, channels, before, after) {
    if (before.width === after.width && before.height === after.height) {
        return values;
    }
    const averages = areaAveraged(values, channels, before, after);
    const isHalved = before.width === 2 * after.width && before.height === 2 * after.height;
    return Uint8ClampedArray.from(isHalved ? averages.map((value) => Math.floor(value + 0.5)) : averages);
}

/**
 * Make a mask smaller: a pixel counts if at least half of what it covers does.
 *
 * @param {Uint8ClampedArray} mask (H, W), 255 or 0
 * @param {Size} before
 * @param {Size} after not more
 * @returns {Uint8ClampedArray}
 */
export function averagedMask(mask, before, after) {
    return averagedPlane(mask, 1, before, after).map((share) => (share > 127 ? 255 : 0));
}
