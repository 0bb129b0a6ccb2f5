/**
 * A capture's files, from an archive or a folder, by their paths.
 *
 * @module
 */

import { readingFault } from "./reading_fault.js";

/** Of a single file that is read whole. */
const MAX_FILE_BYTES = 512e6;

/** A file that is read when it is needed. */
export class StoredFile {
    #read;
    #readStart;
    #whole;

    /**
     * @param {string} path with `/` between folders
     * @param {number} size bytes
     * @param {() => Promise<Uint8Array>} read
     * @param {(most: number) => Promise<Uint8Array>} readStart if there is a way to read only its start
     * @param {Blob | null} whole its content, if that need not be unpacked
     */
    constructor(path, size, read, readStart = async (most) => (await read()).subarray(0, most), whole = null) {
        this.path = path;
        this.size = size;
        this.#read = read;
        this.#readStart = readStart;
        this.#whole = whole;
    }

    /**
     * @param {File} file
     * @param {string} path
     * @returns {StoredFile}
     */
    static ofDisk(file, path) {
        const readStart = async (most) => {
            try {
                return new Uint8Array(await file.slice(0, most).arrayBuffer());
            } catch (error) {
                throw new Error(`${path} ${readingFault(error) ?? error.message}`);
            }
        };
        return new StoredFile(path, file.size, () => readStart(file.size), readStart, file);
    }

    /**
     * @returns {Promise<Uint8Array>} its content
     * @throws {Error} it is too large, or damaged
     */
    async bytes() {
        if (this.size > MAX_FILE_BYTES) {
            const [found, most] = [Math.ceil(this.size / 1e6), MAX_FILE_BYTES / 1e6];
            throw new Error(`the file ${this.path} would take ${found} MB: expected at most ${most} MB`);
        }
        return this.#read();
    }

    /** The same file with another path. @type {(path: string) => StoredFile} */
    at(path) {
        return new StoredFile(path, this.size, () => this.bytes(), this.#readStart, this.#whole);
    }

    /** Its content, of which only what is used is read if it need not be unpacked. @returns {Promise<Blob>} */
    async blob() {
        return this.#whole ?? new Blob([await this.bytes()]);
    }

    /** Its first bytes, at most so many, which are not checked. @type {(most: number) => Promise<Uint8Array>} */
    start(most) {
        return this.#readStart(most);
    }

    /**
     * @returns {Promise<string>} its content
     * @throws {Error} it is not UTF-8
     */
    async text() {
        const bytes = await this.bytes();
        try {
            return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
        } catch {
            throw new Error(`${this.path}: not UTF-8 text`);
        }
    }
}

/** Files by their paths; those of a folder in a larger tree may name files beside that folder by paths with `..`. */
export class FileTree {
    #files = new Map();
    #byLowerCase = new Map();
    #around;
    #folder;

    /**
     * @param {StoredFile[]} files those that systems add, such as `__MACOSX/`, are left out
     * @param {FileTree | null} around the tree that they are a folder of
     * @param {string} folder its path there
     * @throws {Error} a path is used twice, or would lead out of a folder
     */
    constructor(files, around = null, folder = "") {
        this.#around = around;
        this.#folder = folder;
        for (const file of files) {
            const parts = file.path.split("/");
            if (parts.some((part) => part === ".." || part === "" || /^[a-z]:/i.test(part) || /[\\\0]/.test(part))) {
                throw new Error(`the file ${JSON.stringify(file.path)} leads out of its folder: expected a plain path`);
            }
            if (parts.some((part) => part.startsWith(".") || part === "__MACOSX")) {
                continue;
            }
            if (this.#files.has(file.path)) {
                throw new Error(`the file ${file.path} is there twice: expected it once`);
            }
            this.#files.set(file.path, file);
            this.#byLowerCase.set(spelling(file.path), file);
        }
    }

    /** @returns {string[]} all paths */
    get paths() {
        return [...this.#files.keys()];
    }

    /**
     * @param {string} path case and the encoding of accents may differ
     * @returns {StoredFile | undefined}
     */
    find(path) {
        const plain = normalised(path);
        if (this.#around && leadsOut(plain)) {
            const file = this.#around.find(`${this.#folder}/${plain}`);
            return file?.at(this.#fromHere(file.path));
        }
        return this.#files.get(plain) ?? this.#byLowerCase.get(spelling(plain));
    }

    /**
     * The files of a folder, by their paths in it.
     *
     * @param {string} folder
     * @returns {FileTree}
     */
    below(folder) {
        if (folder === "") {
            return this;
        }
        const inside = [...this.#files.values()].filter(({ path }) => path.startsWith(`${folder}/`));
        return new FileTree(inside.map((file) => file.at(file.path.slice(folder.length + 1))), this, folder);
    }

    /** The number of folders around this one. @returns {number} */
    get depth() {
        return this.#around ? this.#around.depth + this.#folder.split("/").length : 0;
    }

    /**
     * A stated path as one of the tree.
     *
     * @param {string} folder that it is relative to
     * @param {string} path with either separator
     * @param {string} where the file that states it, for messages
     * @returns {string}
     * @throws {Error} it is absolute, or leads out of the outermost folder
     */
    inside(folder, path, where) {
        const plain = normalised(`${folder}/${withSlashes(path)}`);
        const climbed = plain.split("/").filter((part) => part === "..").length;
        if (/^[/\\]/.test(path) || climbed > this.depth) {
            throw new Error(`${where}: names the file ${path}, which lies outside the capture's folder`);
        }
        return plain;
    }

    /**
     * Paths of the files directly in a folder, in order.
     *
     * @param {string} folder "" for the topmost
     * @param {(name: string) => boolean} isWanted
     * @returns {string[]}
     */
    pathsIn(folder, isWanted) {
        return this.pathsBelow(folder).filter((path) => folderOf(path) === folder && isWanted(nameOf(path))).sort();
    }

    /** Paths of the files below a folder. @type {(folder: string) => string[]} */
    pathsBelow(folder) {
        if (this.#around && leadsOut(folder)) {
            const found = this.#around.pathsBelow(normalised(`${this.#folder}/${folder}`));
            return found.map((path) => this.#fromHere(path));
        }
        return folder === "" ? this.paths : this.paths.filter((path) => path.startsWith(`${folder}/`));
    }

    /** Whether there is a file below a folder. @type {(folder: string) => boolean} */
    hasFolder(folder) {
        return this.pathsBelow(folder).length > 0;
    }

    /** A path of the tree around this one, as seen from here. */
    #fromHere(path) {
        const [own, up] = [`${this.#folder}/`, "../".repeat(this.#folder.split("/").length)];
        return path.startsWith(own) ? path.slice(own.length) : up + path;
    }
}

/**
 * A path without `.` and `..`, as far as that is possible.
 *
 * @param {string} path
 * @returns {string}
 */
export function normalised(path) {
    const parts = [];
    for (const part of path.split("/")) {
        if (part === ".." && parts.length && parts.at(-1) !== "..") {
            parts.pop();
        } else if (part !== "." && part !== "") {
            parts.push(part);
        }
    }
    return parts.join("/");
}

/** Whether a plain path begins above its folder. */
function leadsOut(path) {
    return path.split("/")[0] === "..";
}

/** A path as written on Windows, with `/` as the separator. @type {(path: string) => string} */
export function withSlashes(path) {
    return path.replaceAll("\\", "/");
}

/** The last part of a path. @type {(path: string) => string} */
export function nameOf(path) {
    return path.slice(path.lastIndexOf("/") + 1);
}

/** A path without its last part and the slash before it; "" where there is none. @type {(path: string) => string} */
export function folderOf(path) {
    return path.slice(0, Math.max(path.lastIndexOf("/"), 0));
}

/** A path without what differs between systems: case, and the encoding of accents. @type {(path: string) => string} */
export function spelling(path) {
    return path.normalize("NFC").toLowerCase();
}
