/**
 * Where the frames of a video lie in an MP4 or QuickTime file, and how they are coded: the tables of its first video
 * track (ISO 14496-12), for H.264 (14496-15, section 5.3.3) and HEVC (section 8.3.3).
 *
 * @module
 */

/**
 * @typedef {Object} Sample one coded frame, in the order in which frames are decoded
 * @property {number} start byte in the file
 * @property {number} size bytes
 * @property {number} time at which it is shown, in the file's units; unlike those of all other frames
 * @property {boolean} isKey whether it is decoded without others
 *
 * @typedef {Object} Track
 * @property {string} codec as browsers name it
 * @property {Uint8Array} description the decoder's configuration
 * @property {number} width pixels as stored
 * @property {number} height
 * @property {Sample[]} samples
 * @property {Map<number, number>} shown by their times, the numbers of frames in the order in which they are shown
 */

/** At 60 frames a second, more than two hours. */
const MAX_SAMPLES = 500_000;

/** Of a box's type and size, of the fields before its tables, and of a video's sample entry. */
const [HEADER, FULL_HEADER, ENTRY_FIELDS] = [8, 4, 78];

const CONFIGURATIONS = { avc1: "avcC", avc3: "avcC", hvc1: "hvcC", hev1: "hvcC" };

/**
 * @param {Uint8Array} bytes of the file
 * @param {string} path for messages
 * @returns {Track}
 * @throws {Error} there is no video of a known codec in it, or it is broken
 */
export function readTrack(bytes, path) {
    try {
        return videoTrack(new Box(new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), "file"));
    } catch (error) {
        const found = error instanceof RangeError ? "its tables are cut short" : error.message;
        throw new Error(`${path}: ${found}, expected a whole MP4 file with a video`);
    }
}

/** A part of the file that holds others. */
class Box {
    constructor(view, type) {
        [this.view, this.type] = [view, type];
    }

    /** The parts that it holds from a place on. */
    *inner(from = 0) {
        for (let at = from; at + HEADER <= this.view.byteLength; ) {
            const type = textAt(this.view, at + 4);
            const [stated, isLong] = [this.view.getUint32(at), this.view.getUint32(at) === 1];
            const begin = at + HEADER + (isLong ? 8 : 0);
            const left = this.view.byteLength - at;
            const size = isLong ? Number(this.view.getBigUint64(at + HEADER)) : stated || left;
            if (size < begin - at || size > left) {
                throw new Error(`its part '${type}' is cut short`);
            }
            yield new Box(partOf(this.view, begin, at + size - begin), type);
            at += size;
        }
    }

    /** The first part of a type. @type {(type: string, from?: number) => Box | undefined} */
    find(type, from) {
        for (const part of this.inner(from)) {
            if (part.type === type) {
                return part;
            }
        }
        return undefined;
    }

    /** The part at the end of a path of types. @type {(...types: string[]) => Box} */
    at(...types) {
        return types.reduce((box, type) => box.find(type) ?? missing(type), this);
    }

    /** The rows of a table of 32-bit numbers, whose count stands before them. */
    *rows(columns, first = FULL_HEADER) {
        const count = this.view.getUint32(first);
        if (count * columns * 4 > this.view.byteLength - first - 4) {
            throw new Error(`its table '${this.type}' is cut short`);
        }
        for (let row = 0; row < count; row++) {
            const at = first + 4 + 4 * columns * row;
            yield Array.from({ length: columns }, (_, column) => this.view.getUint32(at + 4 * column));
        }
    }
}

function videoTrack(file) {
    for (const track of file.at("moov").inner()) {
        if (track.type === "trak" && textAt(track.at("mdia", "hdlr").view, 8) === "vide") {
            return readVideo(track, file.view.byteLength);
        }
    }
    return missing("trak");
}

function readVideo(track, fileBytes) {
    const tables = track.at("mdia", "minf", "stbl");
    const sizes = sampleSizes(tables.at("stsz"));
    const starts = sampleStarts(tables, sizes);
    const times = shownTimes(tables, sizes.length);
    const keys = tables.find("stss");
    const isKey = keys && new Set([...keys.rows(1)].map(([number]) => number - 1));
    const samples = Array.from(sizes, (size, i) => {
        return { start: starts[i], size, time: times[i], isKey: isKey?.has(i) ?? true };
    });
    if (samples.some(({ start, size }) => start + size > fileBytes)) {
        throw new Error("a frame lies beyond its end");
    }
    if (!samples[0]?.isKey) {
        throw new Error(samples.length ? "it does not begin with a whole frame" : "it lists no frame");
    }
    return { ...readEntry(tables.at("stsd")), samples, shown: shownOrder(times, firstTime(track)) };
}

/** The numbers of the frames in the order in which they are shown, without those that an edit leaves out. */
function shownOrder(times, first) {
    const inOrder = times.filter((time) => time >= first).sort();
    if (inOrder.some((time, i) => time === inOrder[i - 1])) {
        throw new Error("two frames are shown at once");
    }
    return new Map(Array.from(inOrder, (time, i) => [time, i]));
}

/** When the track begins, by its first edit that shows something (section 8.6.6). */
function firstTime(track) {
    const list = track.find("edts")?.find("elst");
    if (!list) {
        return -Infinity;
    }
    const isLong = list.view.getUint8(0) === 1;
    for (const row of list.rows(isLong ? 5 : 3)) {
        const [high, low] = isLong ? [row[2], row[3]] : [0, row[1]];
        // A time of -1 shows nothing.
        if (!((isLong ? high : low) >> 31)) {
            return high * 2 ** 32 + low;
        }
    }
    return -Infinity;
}

function sampleSizes({ view, type }) {
    const [same, count] = [view.getUint32(4), view.getUint32(8)];
    if (count > MAX_SAMPLES) {
        throw new Error(`it has ${count} frames, more than ${MAX_SAMPLES}`);
    }
    if (!same && 4 * count > view.byteLength - 12) {
        throw new Error(`its table '${type}' is cut short`);
    }
    return Float64Array.from({ length: count }, (_, i) => same || view.getUint32(12 + 4 * i));
}

/** Samples lie one after another in chunks; runs of chunks hold equally many. */
function sampleStarts(tables, sizes) {
    const long = tables.find("co64");
    const chunks = long
        ? [...long.rows(2)].map(([high, low]) => high * 2 ** 32 + low)
        : [...tables.at("stco").rows(1)].map(([start]) => start);
    const runs = [...tables.at("stsc").rows(3)];
    const starts = new Float64Array(sizes.length);
    let sample = 0;
    runs.forEach(([first, count], run) => {
        const end = Math.min(runs[run + 1]?.[0] ?? chunks.length + 1, chunks.length + 1);
        for (let chunk = first; chunk < end && sample < sizes.length; chunk++) {
            let at = chunks[chunk - 1] ?? NaN;
            for (let i = 0; i < count && sample < sizes.length; i++, sample++) {
                starts[sample] = at;
                at += sizes[sample];
            }
        }
    });
    if (sample < sizes.length || starts.some(Number.isNaN)) {
        throw new Error("its chunks do not hold all frames");
    }
    return starts;
}

/** When each sample is shown: it is decoded after the ones before it, and shown an offset later. */
function shownTimes(tables, count) {
    const times = spread(tables.at("stts"), count);
    let total = 0;
    times.forEach((duration, i) => {
        times[i] = total;
        total += duration;
    });
    const offsets = tables.find("ctts");
    if (offsets) {
        // Of version 1 they are signed, and files of version 0 with signed ones exist.
        spread(offsets, count).forEach((offset, i) => (times[i] += offset | 0));
    }
    return times;
}

/** Runs of equal numbers, as one number per sample. */
function spread(table, count) {
    const values = new Float64Array(count);
    let sample = 0;
    for (const [length, value] of table.rows(2)) {
        const end = Math.min(sample + length, count);
        values.fill(value, sample, end);
        sample = end;
    }
    if (sample < count) {
        throw new Error(`its table '${table.type}' is cut short`);
    }
    return values;
}

function readEntry(table) {
    const [entry] = table.inner(FULL_HEADER + 4);
    const wanted = CONFIGURATIONS[entry?.type];
    if (!wanted) {
        throw new Error(`its video is of the kind '${entry?.type}', not H.264 or HEVC`);
    }
    const { view } = entry.find(wanted, ENTRY_FIELDS) ?? missing(wanted);
    const [width, height] = [entry.view.getUint16(24), entry.view.getUint16(26)];
    const codec = `${entry.type}.${wanted === "avcC" ? profileOfAvc(view) : profileOfHevc(view)}`;
    return { codec, description: new Uint8Array(view.buffer, view.byteOffset, view.byteLength), width, height };
}

/** Profile, what it is compatible with, and level (RFC 6381, section 3.3). */
function profileOfAvc(view) {
    return [1, 2, 3].map((at) => hexadecimal(view.getUint8(at)).padStart(2, "0")).join("");
}

/** Space and number of the profile, what it is compatible with, tier and level, constraints (14496-15, annex E). */
function profileOfHevc(view) {
    const general = view.getUint8(1);
    const compatible = Array.from({ length: 32 }, (_, bit) => (view.getUint32(2) >>> bit) & 1).join("");
    const constraints = [6, 7, 8, 9, 10, 11].map((at) => view.getUint8(at));
    const last = constraints.findLastIndex((byte) => byte !== 0);
    return [
        `${["", "A", "B", "C"][general >> 6]}${general & 31}`,
        hexadecimal(Number.parseInt(compatible, 2)),
        `${general & 32 ? "H" : "L"}${view.getUint8(12)}`,
        ...constraints.slice(0, last + 1).map(hexadecimal),
    ].join(".");
}

const hexadecimal = (number) => number.toString(16).toUpperCase();

function partOf(view, start, size) {
    return new DataView(view.buffer, view.byteOffset + start, size);
}

function textAt(view, at) {
    return String.fromCharCode(...[0, 1, 2, 3].map((i) => view.getUint8(at + i)));
}

function missing(type) {
    throw new Error(`it has no part '${type}'`);
}
