/**
 * Sizes of files and scenes as text.
 *
 * @module
 */

/** @type {(bytes: number) => string} */
export function sizeOf(bytes) {
    return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)}\u00a0KB` : `${(bytes / 1e6).toFixed(bytes < 1e8 ? 1 : 0)}\u00a0MB`;
}
