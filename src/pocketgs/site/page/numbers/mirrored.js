/**
 * Images beyond their borders.
 *
 * @module
 */

/** A place on a line, mirrored at its ends without repeating them. @type {(i: number, length: number) => number} */
export function mirrored(i, length) {
    let place = i;
    while (length > 1 && (place < 0 || place >= length)) {
        place = place < 0 ? -place : 2 * (length - 1) - place;
    }
    return length > 1 ? place : 0;
}
