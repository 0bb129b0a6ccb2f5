/**
 * The numbers of 64 bits in zip files (PKWARE's APPNOTE, sections 4.3.14, 4.3.15 and 4.5.3): those of archives over 4 GB,
 * and of programs that do not know sizes beforehand.
 *
 * @module
 */

const LOCATOR_BYTES = 20;
const RECORD_BYTES = 56;
const LOCATOR_MARK = 0x0706_4b50;
const RECORD_MARK = 0x0606_4b50;
/** Of the extra field with an entry's numbers. */
const FIELD = 1;
/** What a field of 32 bits holds where the number stands in a field of 64 bits elsewhere. */
const ELSEWHERE = 0xffff_ffff;

/**
 * @typedef {Object} Directory where the list of files is
 * @property {number} count of files
 * @property {number} bytes
 * @property {number} offset
 */

/** Whether the end of the archive has not all of its numbers. @type {(found: Directory) => boolean} */
export function isElsewhere({ count, bytes, offset }) {
    return count === 0xffff || bytes === ELSEWHERE || offset === ELSEWHERE;
}

/**
 * @param {number} end where the end begins that has not all of its numbers
 * @param {(start: number, bytes: number) => Promise<DataView>} read gives a part of the archive
 * @returns {Promise<Directory | null>} null if they are not there either
 */
export async function wideDirectory(end, read) {
    const locator = await marked(end - LOCATOR_BYTES, LOCATOR_BYTES, LOCATOR_MARK, end, read);
    const record = locator && (await marked(wide(locator, 8), RECORD_BYTES, RECORD_MARK, end, read));
    return record && { count: wide(record, 32), bytes: wide(record, 40), offset: wide(record, 48) };
}

/**
 * An entry's numbers, each from its extra field if it stands there.
 *
 * @param {number[]} numbers in the field's order
 * @param {DataView} extra all of the entry's extra fields
 * @returns {number[]}
 */
export function widened(numbers, extra) {
    const [start, end] = fieldIn(extra);
    let at = start;
    return numbers.map((number) => {
        if (number !== ELSEWHERE || at + 8 > end) {
            return number;
        }
        at += 8;
        return wide(extra, at - 8);
    });
}

/** Where the field begins and ends. */
function fieldIn(extra) {
    for (let at = 4; at <= extra.byteLength; ) {
        const [id, bytes] = [extra.getUint16(at - 4, true), extra.getUint16(at - 2, true)];
        if (id === FIELD) {
            return [at, Math.min(at + bytes, extra.byteLength)];
        }
        at += bytes + 4;
    }
    return [0, 0];
}

async function marked(start, bytes, mark, end, read) {
    const found = start >= 0 && start + bytes <= end ? await read(start, bytes) : null;
    return found?.getUint32(0, true) === mark ? found : null;
}

function wide(view, at) {
    return Number(view.getBigUint64(at, true));
}
