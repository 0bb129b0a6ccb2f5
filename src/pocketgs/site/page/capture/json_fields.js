/**
 * Typed access to JSON, with messages that name the file, the field and what was found; see `files/json_fields.py`.
 *
 * @module
 */

const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

/** The number that a text holds, as some programs write them; any other value as it is. */
const numberIn = (value) => (typeof value === "string" && value.trim() ? Number(value) : value);

/** Texts, and the numbers that only Python writes and reads: these become infinite, which nobody accepts. */
const UNKNOWN = /"[^"\\]*(?:\\.[^"\\]*)*"|NaN|Infinity/g;

function parsed(text) {
    try {
        return JSON.parse(text);
    } catch {
        return JSON.parse(text.replace(UNKNOWN, (word) => (word[0] === '"' ? word : "1e999")));
    }
}

/** One object of a JSON file. */
export class Fields {
    /**
     * @param {Object<string, any>} values
     * @param {string} where the file and the place in it, for messages
     */
    constructor(values, where) {
        this.values = values;
        this.where = where;
    }

    /**
     * @param {import("../archive/tree.js").StoredFile} file
     * @returns {Promise<Fields>}
     * @throws {Error} it is no JSON object
     */
    static async of(file) {
        const text = await file.text();
        let values;
        try {
            values = parsed(text);
        } catch (error) {
            throw new Error(`${file.path}: not JSON (${error.message})`);
        }
        if (!isObject(values)) {
            throw new Error(`${file.path}: not a JSON object`);
        }
        return new Fields(values, file.path);
    }

    /** These fields, with others where they are missing. @type {(others: Fields) => Fields} */
    over(others) {
        return new Fields({ ...others.values, ...this.values }, this.where);
    }

    /** @type {(name: string) => number} a finite number */
    number(name) {
        const value = this.optionalNumber(name);
        if (value === null) {
            throw this.#wrong(name, "a finite number");
        }
        return value;
    }

    /** @type {(name: string) => number | null} a finite number, or null where there is none */
    optionalNumber(name) {
        const value = this.#optional(name, (value) => Number.isFinite(numberIn(value)), "a finite number");
        return value === null ? null : numberIn(value);
    }

    /** @type {(name: string) => string} */
    text(name) {
        const value = this.optionalText(name);
        if (value === null) {
            throw this.#wrong(name, "text");
        }
        return value;
    }

    /** @type {(name: string) => string | null} */
    optionalText(name) {
        return this.#optional(name, (value) => typeof value === "string" && value !== "", "text");
    }

    /** @type {(name: string) => string[] | null} */
    optionalTexts(name) {
        const isSound = (value) => Array.isArray(value) && value.every((text) => typeof text === "string");
        return this.#optional(name, isSound, "a list of texts");
    }

    /** @type {(name: string) => boolean} false where there is none */
    flag(name) {
        return this.#optional(name, (value) => typeof value === "boolean", "true or false") ?? false;
    }

    /** @type {(name: string) => Fields[]} the objects of a list, with their places */
    objects(name) {
        const value = this.values[name];
        if (!Array.isArray(value) || !value.every(isObject)) {
            throw this.#wrong(name, "a list of objects");
        }
        return value.map((one, i) => new Fields(one, `${this.where}, ${name}[${i}]`));
    }

    /** @type {(name: string, count: number) => number[]} */
    numbers(name, count) {
        const value = this.values[name];
        if (!Array.isArray(value) || value.length !== count || !value.every(Number.isFinite)) {
            throw this.#wrong(name, `${count} finite numbers`);
        }
        return value;
    }

    /** @type {(name: string, rows: number[], columns: number) => number[][]} `rows` are the numbers of rows allowed */
    matrix(name, rows, columns) {
        const value = this.values[name];
        if (!Array.isArray(value) || !rows.includes(value.length)) {
            throw this.#wrong(name, `a matrix of ${rows.join(" or ")} rows of ${columns} numbers`);
        }
        return this.table(name, columns);
    }

    /** @type {(name: string, columns: number) => number[][]} at least one row of numbers */
    table(name, columns) {
        const value = this.values[name];
        const isRow = (row) => Array.isArray(row) && row.length === columns && row.every(Number.isFinite);
        if (!Array.isArray(value) || !value.length || !value.every(isRow)) {
            throw this.#wrong(name, `rows of ${columns} finite numbers`);
        }
        return value;
    }

    #optional(name, isSound, expected) {
        const value = this.values[name] ?? null;
        if (value !== null && !isSound(value)) {
            throw this.#wrong(name, expected);
        }
        return value;
    }

    #wrong(name, expected) {
        const value = this.values[name];
        const told = Math.abs(value) === Infinity ? "no finite number" : JSON.stringify(value)?.slice(0, 60);
        const found = value === undefined ? "nothing" : told;
        return new Error(`${this.where}: field '${name}' is ${found}, expected ${expected}`);
    }
}
