/**
 * Tables of numbers in CSV files.
 *
 * @module
 */

/** A recording of an hour has fewer lines. */
const MAX_LINES = 500_000;

/** What a number looks like. `Number` alone would take nothing for 0, and words such as 0x1 for numbers. */
const NUMBER = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i;

/**
 * Read the lines of a table that are not empty.
 *
 * @param {import("../archive/tree.js").StoredFile} file
 * @returns {Promise<{line: number, words: string[], numbers: number[]}[]>} lines count from 1; NaN is what is no number
 * @throws {Error} it is not UTF-8, or too long
 */
export async function readTable(file) {
    const lines = (await file.text()).split(/\r\n|[\n\r]/);
    if (lines.length > MAX_LINES) {
        throw new Error(`${file.path}: ${lines.length} lines, expected at most ${MAX_LINES}`);
    }
    return lines.flatMap((text, i) => {
        if (!text.trim()) {
            return [];
        }
        const words = text.split(",").map((word) => word.trim().replace(/^"(.*)"$/, "$1"));
        const numbers = words.map((word) => (NUMBER.test(word) ? Number(word) : NaN));
        return [{ line: i + 1, words, numbers }];
    });
}
