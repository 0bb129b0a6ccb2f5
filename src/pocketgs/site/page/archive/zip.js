/**
 * Reading zip files without unpacking them (PKWARE's APPNOTE, section 4.3): stored and deflated files.
 *
 * @module
 */

import { crc32 } from "../../page/formats/crc32.js";
import { taken } from "./inflate.js";
import { readingFault } from "./reading_fault.js";
import { StoredFile } from "./tree.js";
import { isElsewhere, wideDirectory, widened } from "./zip64.js";
import { pathsOf } from "./zip_names.js";

const END_BYTES = 22;
const MAX_COMMENT = 0xffff;
const ENTRY_BYTES = 46;
const LOCAL_BYTES = 30;
const END_MARK = 0x0605_4b50;
const ENTRY_MARK = 0x0201_4b50;
const LOCAL_MARK = 0x0403_4b50;
const ENCRYPTED = 1;
const STORED = 0;
const DEFLATED = 8;
const MAX_FILES = 50_000;
const MAX_DIRECTORY_BYTES = 1 << 26;

/**
 * List the files of an archive. Nothing is unpacked before it is read.
 *
 * @param {Blob} archive
 * @param {string} name of the archive, for messages
 * @returns {Promise<StoredFile[]>}
 * @throws {Error} it is no zip file, or a broken one
 */
export async function filesInZip(archive, name) {
    const refused = (found) => new Error(`${name}: ${found}`);
    const { count, offset, bytes, before } = await findDirectory(archive, refused);
    const directory = await viewOf(archive, before + offset, bytes, refused);
    const entries = [];
    for (let at = 0, i = 0; i < count; i++) {
        if (at + ENTRY_BYTES > directory.byteLength || directory.getUint32(at, true) !== ENTRY_MARK) {
            throw refused(`its list of files is broken after ${i} of ${count}: expected a whole zip file`);
        }
        const entry = readEntry(directory, at);
        at += entry.bytes;
        entries.push(entry);
    }
    const paths = pathsOf(entries);
    if (paths === null) {
        throw refused("its list of files is broken: expected names in UTF-8 where it says so");
    }
    return entries
        .map((entry, i) => ({ ...entry, offset: before + entry.offset, path: paths[i] }))
        .filter(({ path }) => !path.endsWith("/"))
        .map((entry) => {
            const read = () => unpacked(archive, entry, refused);
            const readStart = (most) => startOf(archive, entry, most, refused);
            return new StoredFile(entry.path, entry.size, read, readStart);
        });
}

async function findDirectory(archive, refused) {
    const start = Math.max(0, archive.size - END_BYTES - MAX_COMMENT);
    const end = await viewOf(archive, start, archive.size - start, refused);
    for (let at = end.byteLength - END_BYTES; at >= 0; at--) {
        if (end.getUint32(at, true) !== END_MARK) {
            continue;
        }
        const [bytes, offset] = [12, 16].map((field) => end.getUint32(at + field, true));
        const narrow = { count: end.getUint16(at + 10, true), bytes, offset };
        const read = (from, most) => viewOf(archive, from, most, refused);
        const found = isElsewhere(narrow) ? await wideDirectory(start + at, read) : narrow;
        if (!found || found.offset + found.bytes > start + at || found.bytes > MAX_DIRECTORY_BYTES) {
            throw refused("its list of files is broken: expected a whole zip file");
        }
        if (found.count > MAX_FILES) {
            throw refused(`holds ${found.count} files: expected at most ${MAX_FILES}`);
        }
        // Bytes in front, such as of a program that unpacks the archive, may not be counted.
        const isThere = found !== narrow || (await read(offset, 4)).getUint32(0, true) === ENTRY_MARK;
        return { ...found, before: isThere ? 0 : start + at - bytes - offset };
    }
    throw refused("is no zip file, or cut short: it has no list of files at its end");
}

function readEntry(directory, at) {
    const lengths = [28, 30, 32].map((field) => directory.getUint16(at + field, true));
    const rest = new Uint8Array(directory.buffer, directory.byteOffset + at + ENTRY_BYTES);
    const extra = rest.subarray(lengths[0], lengths[0] + lengths[1]);
    const numbers = [24, 20, 42].map((field) => directory.getUint32(at + field, true));
    const [size, packed, offset] = widened(numbers, new DataView(extra.buffer, extra.byteOffset, extra.byteLength));
    return {
        bytes: ENTRY_BYTES + lengths[0] + lengths[1] + lengths[2],
        flags: directory.getUint16(at + 8, true),
        method: directory.getUint16(at + 10, true),
        sum: directory.getUint32(at + 16, true),
        packed,
        size,
        offset,
        name: rest.subarray(0, lengths[0]),
    };
}

async function unpacked(archive, entry, refused) {
    const stream = await streamOf(archive, entry, refused);
    const bytes = await taken(stream, entry.size).catch((error) => unlessFault(error, entry, refused, null));
    if (bytes === null || crc32(bytes) !== entry.sum) {
        throw refused(`${entry.path} is damaged: its content is not what was packed`);
    }
    return bytes;
}

async function startOf(archive, entry, most, refused) {
    const reader = (await streamOf(archive, entry, refused)).getReader();
    const start = new Uint8Array(Math.min(most, entry.size));
    let filled = 0;
    while (filled < start.length) {
        const { value, done } = await reader.read().catch((error) => {
            return unlessFault(error, entry, refused, { done: true });
        });
        if (done) {
            break;
        }
        start.set(value.subarray(0, start.length - filled), filled);
        filled += value.length;
    }
    await reader.cancel().catch(() => {});
    return start.subarray(0, filled);
}

/** What stands for damaged content, unless it could not be read for another reason. */
function unlessFault(error, { path }, refused, otherwise) {
    const reason = readingFault(error);
    if (reason) {
        throw refused(`${path} ${reason}`);
    }
    return otherwise;
}

/** A packed file's content, as it is unpacked. */
async function streamOf(archive, { path, flags, method, packed, offset }, refused) {
    if (flags & ENCRYPTED) {
        throw refused(`${path} is encrypted: expected a zip file without a password`);
    }
    if (method !== STORED && method !== DEFLATED) {
        throw refused(`${path} is compressed by method ${method}: expected a file that is stored or deflated`);
    }
    const local = offset + LOCAL_BYTES <= archive.size ? await viewOf(archive, offset, LOCAL_BYTES, refused) : null;
    if (local?.getUint32(0, true) !== LOCAL_MARK) {
        throw refused(`${path} is not where its list of files says: expected a whole zip file`);
    }
    const start = offset + LOCAL_BYTES + local.getUint16(26, true) + local.getUint16(28, true);
    const content = archive.slice(start, start + packed).stream();
    return method === DEFLATED ? content.pipeThrough(new DecompressionStream("deflate-raw")) : content;
}

async function viewOf(blob, start, bytes, refused) {
    try {
        return new DataView(await blob.slice(start, start + bytes).arrayBuffer());
    } catch (error) {
        throw refused(readingFault(error) ?? error.message);
    }
}
