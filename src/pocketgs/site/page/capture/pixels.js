/**
 * Images as arrays of RGBA: decoded by the browser, composited, made smaller; see `capture/loading.py`.
 *
 * @module
 */

/**
 * @typedef {Object} Pixels
 * @property {number} width
 * @property {number} height
 * @property {Uint8ClampedArray} rgba (H, W, 4), alpha not multiplied in
 */

/**
 * Decode an image as it is stored: without turning it, and without changing its colours.
 *
 * @param {Uint8Array} bytes
 * @param {string} type such as image/png
 * @param {string} path for messages
 * @returns {Promise<Pixels>}
 * @throws {Error} the browser cannot decode it
 */
export async function decoded(bytes, type, path) {
    const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
    const bitmap = await createImageBitmap(new Blob([bytes], { type }), options).catch(() => {
        throw new Error(`${path}: cannot be decoded, expected a whole image`);
    });
    const { width, height } = bitmap;
    const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    bitmap.close();
    return { width, height, rgba: context.getImageData(0, 0, width, height).data };
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
 * Width and height of an image that is at most so many pixels long.
 *
 * @param {number} width
 * @param {number} height
 * @param {number} most pixels of the longer side
 * @returns {[number, number]}
 */
export function sizeWithin(width, height, most) {
    const longer = Math.max(width, height);
    if (longer <= most) {
        return [width, height];
    }
    return [width, height].map((side) => Math.max(1, roundedToEven((side * most) / longer)));
}

/**
 * Make an image smaller, averaging areas.
 *
 * @param {Pixels} pixels
 * @param {number} width not more than the image's
 * @param {number} height likewise
 * @returns {Pixels}
 */
export function averaged(pixels, width, height) {
    if (width === pixels.width && height === pixels.height) {
        return pixels;
    }
    const [across, down] = [sharesOf(pixels.width, width), sharesOf(pixels.height, height)];
    const rgba = new Uint8ClampedArray(4 * width * height);
    const line = new Float32Array(4 * pixels.width);
    down.forEach(({ first, weights }, row) => {
        line.fill(0);
        weights.forEach((weight, i) => {
            const begin = 4 * pixels.width * (first + i);
            for (let at = 0; at < line.length; at++) {
                line[at] += weight * pixels.rgba[begin + at];
            }
        });
        across.forEach((shares, column) => {
            for (let channel = 0; channel < 4; channel++) {
                let sum = 0;
                for (let i = 0; i < shares.weights.length; i++) {
                    sum += shares.weights[i] * line[4 * (shares.first + i) + channel];
                }
                rgba[4 * (row * width + column) + channel] = sum;
            }
        });
    });
    return { width, height, rgba };
}

/** For each of the new pixels along a side, the first old one that it covers, and by how much it covers each. */
function sharesOf(before, after) {
    const scale = before / after;
    return Array.from({ length: after }, (_, i) => {
        const [low, high] = [i * scale, Math.min((i + 1) * scale, before)];
        const first = Math.floor(low + 1e-9);
        const count = Math.max(1, Math.ceil(high - 1e-9) - first);
        const weights = Array.from({ length: count }, (_, j) => {
            return (Math.min(high, first + j + 1) - Math.max(low, first + j)) / (high - low);
        });
        return { first, weights };
    });
}

/** As Python rounds: halves to the even number. */
function roundedToEven(value) {
    const below = Math.floor(value);
    const isHalf = value - below === 0.5;
    return isHalf ? below + (below % 2) : Math.round(value);
}
