/**
 * 8-bit opacities; the twin of `opacity_from_byte` in `formats/activations.py`.
 *
 * @module
 */

/**
 * The logit of an opacity; 0 and 255 decode to the middle of their rounding intervals.
 *
 * @param {number} byte
 * @returns {number}
 */
export function logitOfByte(byte) {
    const opacity = Math.max(0.25, Math.min(254.75, byte)) / 255;
    return Math.log(opacity) - Math.log1p(-opacity);
}
