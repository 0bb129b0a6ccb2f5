/**
 * Passes as data; the twin of `description.py`, which says what the parts mean.
 *
 * @module
 */

import { evaluate } from "./sizes.js";

/**
 * @typedef {import("./sizes.js").Symbols} Symbols
 * @typedef {import("./uniforms.js").UniformLayout} UniformLayout
 *
 * @typedef {Object} Shader
 * @property {string} source
 * @property {{name: string, access: "uniform" | "read" | "read_write"}[]} bindings
 *
 * @typedef {Object} Pass
 * @property {string} name
 * @property {string} shader
 * @property {string | null} groups
 * @property {[string, number] | null} indirect
 * @property {Object<string, string>} buffers
 * @property {Object<string, number>} constants
 * @property {string} when
 *
 * @typedef {{cleared: string[], passes: Pass[]}} Sequence
 */

const VERSION = 2;

/** Everything that a WebGPU host needs to run some sequences of passes. */
export class Description {
    /**
     * @param {Object} json from `Description.to_json` in Python
     * @throws {Error} it is of another version
     */
    constructor(json) {
        if (json.version !== VERSION) {
            throw new Error(`found a description of version ${json.version}, expected version ${VERSION}`);
        }
        /** @type {Object<string, string>} */
        this.definitions = json.definitions;
        /** @type {Object<string, string>} */
        this.buffers = json.buffers;
        /** @type {Object<string, UniformLayout>} */
        this.uniforms = json.uniforms;
        /** @type {Object<string, Shader>} */
        this.shaders = json.shaders;
        /** @type {Object<string, Sequence>} */
        this.sequences = json.sequences;
    }

    /**
     * The given numbers and all that are derived from them.
     *
     * @param {Symbols} given
     * @returns {Symbols}
     */
    symbols(given) {
        const symbols = { ...given };
        for (const [name, expression] of Object.entries(this.definitions)) {
            symbols[name] = evaluate(expression, symbols);
        }
        return symbols;
    }

    /**
     * Names of the buffers that some sequences use, without uniform buffers.
     *
     * @param {string[]} sequences
     * @returns {string[]}
     */
    buffersOf(sequences) {
        const named = new Set();
        for (const { cleared, passes } of sequences.map((name) => this.sequences[name])) {
            cleared.forEach((name) => named.add(name));
            for (const { shader, buffers, indirect } of passes) {
                this.shaders[shader].bindings.forEach(({ name }) => named.add(buffers[name] ?? name));
                if (indirect) {
                    named.add(indirect[0]);
                }
            }
        }
        return [...named].filter((name) => !(name in this.uniforms));
    }

    /**
     * Sizes of buffers in bytes, multiples of 4 and never 0, which WebGPU does not allow.
     *
     * @param {Symbols} symbols from `symbols`
     * @param {string[]} names of the buffers, if not of all
     * @returns {Object<string, number>}
     */
    sizes(symbols, names = Object.keys(this.buffers)) {
        const sizes = names.map((name) => [name, Math.max(evaluate(this.buffers[name], symbols), 16)]);
        return Object.fromEntries(sizes);
    }
}
