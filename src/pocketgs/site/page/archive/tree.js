/**
 * A capture's files, from an archive or a folder, by their paths.
 *
 * @module
 */

/** Of a single file that is read whole. */
export const MAX_FILE_BYTES = 512e6;

/** A file that is read when it is needed. */
export class StoredFile {
    #read;

    /**
     * @param {string} path with `/` between folders
     * @param {number} size bytes
     * @param {() => Promise<Uint8Array>} read
     */
    constructor(path, size, read) {
        this.path = path;
        this.size = size;
        this.#read = read;
    }

    /**
     * @param {File} file
     * @param {string} path
     * @returns {StoredFile}
     */
    static ofDisk(file, path) {
        return new StoredFile(path, file.size, async () => {
            if (file.size > MAX_FILE_BYTES) {
                const found = Math.ceil(file.size / 1e6);
                throw new Error(`${path} would take ${found} MB: expected at most ${MAX_FILE_BYTES / 1e6} MB`);
            }
            return new Uint8Array(await file.arrayBuffer());
        });
    }

    /** @returns {Promise<Uint8Array>} its content */
    bytes() {
        return this.#read();
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

/** Files by their paths. */
export class FileTree {
    #files = new Map();
    #byLowerCase = new Map();

    /**
     * @param {StoredFile[]} files those that systems add, such as `__MACOSX/`, are left out
     * @throws {Error} a path is used twice, or would lead out of a folder
     */
    constructor(files) {
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
        return this.#files.get(plain) ?? this.#byLowerCase.get(spelling(plain));
    }

    /**
     * @param {string} path whose folders do not count
     * @returns {StoredFile | undefined} the only file of this name in any folder
     */
    findByName(path) {
        const name = spelling(nameOf(path));
        const same = [...this.#files.values()].filter((file) => spelling(nameOf(file.path)) === name);
        return same.length === 1 ? same[0] : undefined;
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
        return new FileTree(
            inside.map((file) => new StoredFile(file.path.slice(folder.length + 1), file.size, () => file.bytes())),
        );
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

function nameOf(path) {
    return path.slice(path.lastIndexOf("/") + 1);
}

function spelling(path) {
    return path.normalize("NFC").toLowerCase();
}
