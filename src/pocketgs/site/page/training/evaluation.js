/**
 * How close renderings are to photographs; see `metrics/evaluation.py`.
 *
 * @module
 */

const LEAST_ERROR = 1e-10;

/**
 * Peak signal-to-noise ratio of a rendering that is cut off at 0 and 1, as on a screen.
 *
 * @param {Float32Array} rendered (H, W, 4)
 * @param {Uint8ClampedArray} photograph (H, W, 4), 0 to 255
 * @param {Uint8ClampedArray | null} mask (H, W), not 0 where pixels count; null for all
 * @returns {number} dB, at most 100
 */
export function psnr(rendered, photograph, mask = null) {
    let [sum, count] = [0, 0];
    for (let i = 0; i < rendered.length; i++) {
        if (i % 4 < 3 && (mask?.[i >> 2] ?? 1)) {
            sum += (Math.min(Math.max(rendered[i], 0), 1) - photograph[i] / 255) ** 2;
            count++;
        }
    }
    return -10 * Math.log10(Math.max(sum / count, LEAST_ERROR));
}

/**
 * A rendering as an image for the screen.
 *
 * @param {Float32Array} rendered (H, W, 4)
 * @returns {Uint8ClampedArray} (H, W, 4), opaque
 */
export function onScreen(rendered) {
    return Uint8ClampedArray.from(rendered, (value, i) => (i % 4 < 3 ? 255 * value : 255));
}
