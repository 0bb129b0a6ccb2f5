/**
 * Pairing files with photographs by the last numbers in their names; the twin of `capture/last_numbers.py`.
 *
 * @module
 */

import { stemOf } from "./named_images.js";

/**
 * The file of each photograph by the last number in its name.
 *
 * @param {string[]} photographs their paths, with either separator
 * @param {string[]} files paths of their masks, or of copies that were renamed
 * @returns {Map<string, string>} files by photograph; empty unless both have the same numbers, each once
 */
export function pairByNumber(photographs, files) {
    const byNumber = new Map(files.map((path) => [lastNumber(path), path]));
    const numbers = photographs.map(lastNumber);
    const areOwn = new Set(numbers).size === photographs.length && byNumber.size === files.length;
    const agree = photographs.length === files.length && numbers.every((number) => byNumber.has(number));
    if (!areOwn || !agree || byNumber.has(null)) {
        return new Map();
    }
    return new Map(photographs.map((name, i) => [name, byNumber.get(numbers[i])]));
}

/** Without leading zeros; null where there is none. */
function lastNumber(path) {
    const digits = stemOf(path).match(/\d+/g)?.at(-1);
    return digits === undefined ? null : digits.replace(/^0+(?=\d)/, "");
}
