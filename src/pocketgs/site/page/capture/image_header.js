/**
 * What the headers of JPEG and PNG files say, before anything is decoded.
 *
 * @module
 */

/**
 * @typedef {Object} ImageHeader
 * @property {number} width pixels as stored
 * @property {number} height
 * @property {string} type
 * @property {Uint8Array} plain the file without EXIF, by which browsers would turn it, and without what states its colours,
 *     by which Safari would change them whatever is asked of it
 * @property {Uint8Array} coloured the same with its colour profile, by which browsers bring photographs to sRGB
 * @property {Uint8Array} turnable the same with EXIF too
 */

/** A file is not an image, or a damaged one, such as one whose transfer was interrupted. */
export class DamagedImageError extends Error {}

/**
 * For `catch` where damaged images are left out: the error of one, in place of what it would have been.
 *
 * @param {Error} error
 * @returns {DamagedImageError}
 * @throws {Error} it is another error
 */
export function damage(error) {
    if (error instanceof DamagedImageError) {
        return error;
    }
    throw error;
}

/** Most files state their size within so many bytes. */
const START_BYTES = 1 << 16;

/** An image of more pixels would not fit into a phone's memory. */
export const MAX_PIXELS = 120e6;

const START_OF_IMAGE = 0xffd8;
const START_OF_SCAN = 0xda;
const [EXIF, PROFILE] = [0xe1, 0xe2];
const PNG = [0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a];

/** What a part of a file is about. */
const [TURN, PROFILED, COLOURS, OTHER] = [0, 1, 2, 3];

/** Python knows only the profile. */
const PNG_PARTS = { eXIf: TURN, iCCP: PROFILED, cICP: COLOURS, sRGB: COLOURS, gAMA: COLOURS, cHRM: COLOURS };

/** Whether a file is an image that the page reads, by its name. @type {(path: string) => boolean} */
export const isImage = (path) => /\.(png|jpe?g|jpe|jfif)$/i.test(path);

/**
 * @param {Uint8Array} bytes of the file
 * @param {string} path for messages
 * @returns {ImageHeader}
 * @throws {DamagedImageError} it is neither a JPEG nor a PNG
 * @throws {Error} it is too large
 */
export function readHeader(bytes, path) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const header = PNG.every((byte, i) => bytes[i] === byte) ? readPng(view, bytes) : readJpeg(view, bytes);
    if (!header || header.width < 1 || header.height < 1) {
        throw new DamagedImageError(`${path}: not a whole JPEG or PNG image`);
    }
    if (header.width * header.height > MAX_PIXELS) {
        const found = `${header.width}x${header.height} pixels`;
        throw new Error(`${path}: ${found}, expected at most ${MAX_PIXELS / 1e6} million`);
    }
    return header;
}

/**
 * Width and height of an image as stored, mostly from its first bytes.
 *
 * @param {import("../archive/tree.js").StoredFile} file
 * @returns {Promise<[number, number]>}
 * @throws {DamagedImageError} it is neither a JPEG nor a PNG
 * @throws {Error} it is too large, or cannot be read
 */
export async function storedSize(file) {
    const start = await file.start(START_BYTES);
    const isShort = start.length < START_BYTES;
    const header = sizeIn(start) ?? readHeader(isShort ? start : await file.bytes(), file.path);
    return [header.width, header.height];
}

/** Null where the size stands further behind. */
function sizeIn(bytes) {
    try {
        return readHeader(bytes, "");
    } catch {
        return null;
    }
}

/** Chunk by chunk (ISO 15948). */
function readPng(view, bytes) {
    if (view.byteLength < 24) {
        return null;
    }
    const parts = [{ about: OTHER, content: bytes.subarray(0, PNG.length) }];
    for (let at = PNG.length; at < view.byteLength; ) {
        const end = at + 8 <= view.byteLength ? at + 12 + view.getUint32(at) : view.byteLength;
        parts.push({ about: PNG_PARTS[textIn(bytes, at + 4, 4)] ?? OTHER, content: bytes.subarray(at, end) });
        at = end;
    }
    return { width: view.getUint32(16), height: view.getUint32(20), type: "image/png", ...without(parts) };
}

/** Segment by segment, up to where the pixels begin (ITU T.81, annex B). */
function readJpeg(view, bytes) {
    if (view.byteLength < 4 || view.getUint16(0) !== START_OF_IMAGE) {
        return null;
    }
    const parts = [{ about: OTHER, content: bytes.subarray(0, 2) }];
    let size = null;
    for (let at = 2; at + 4 <= view.byteLength; ) {
        const kind = view.getUint8(at + 1);
        if (view.getUint16(at) === 0xffff) {
            at++; // any number of these may come before a segment
            continue;
        }
        if (view.getUint8(at) !== 0xff || kind === START_OF_SCAN) {
            parts.push({ about: OTHER, content: bytes.subarray(at) });
            break;
        }
        const end = at + 2 + view.getUint16(at + 2);
        if (isFrame(kind) && at + 9 <= view.byteLength) {
            size = { height: view.getUint16(at + 5), width: view.getUint16(at + 7) };
        }
        const isProfile = kind === PROFILE && textIn(bytes, at + 4, 11) === "ICC_PROFILE";
        parts.push({ about: kind === EXIF ? TURN : isProfile ? PROFILED : OTHER, content: bytes.subarray(at, end) });
        at = end;
    }
    return size && { ...size, type: "image/jpeg", ...without(parts) };
}

/** A file without what would turn it or change its colours. */
function without(parts) {
    return {
        plain: joined(parts.filter(({ about }) => about === OTHER)),
        coloured: joined(parts.filter(({ about }) => about === OTHER || about === PROFILED)),
        turnable: joined(parts.filter(({ about }) => about !== COLOURS)),
    };
}

const textIn = (bytes, at, length) => String.fromCharCode(...bytes.subarray(at, at + length));

/** Whether a segment begins a frame, and so states the size: SOF0 to SOF15 but for three that are none. */
function isFrame(kind) {
    return kind >= 0xc0 && kind <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(kind);
}

function joined(parts) {
    const whole = new Uint8Array(parts.reduce((sum, { content }) => sum + content.length, 0));
    let at = 0;
    for (const { content } of parts) {
        whole.set(content, at);
        at += content.length;
    }
    return whole;
}
