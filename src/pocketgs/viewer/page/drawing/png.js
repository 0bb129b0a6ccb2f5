/**
 * Encoding a canvas.
 *
 * @module
 */

/**
 * @param {HTMLCanvasElement} canvas as it is when this is called
 * @returns {Promise<Blob>} a PNG
 * @throws {Error} the browser cannot encode it
 */
export function pngOf(canvas) {
    return new Promise((resolve, reject) => {
        const refuse = () => reject(new Error("the browser could not encode the picture: expected a smaller window"));
        canvas.toBlob((blob) => (blob ? resolve(blob) : refuse()), "image/png");
    });
}
