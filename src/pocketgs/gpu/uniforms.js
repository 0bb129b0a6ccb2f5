/**
 * Packing uniform buffers; the twin of `uniforms.py`.
 *
 * @module
 */

/** @typedef {{size: number, fields: Object<string, {type: string, offset: number}>}} UniformLayout sizes in bytes */

const TYPES = {
    f32: [Float32Array, 1],
    u32: [Uint32Array, 1],
    vec2f: [Float32Array, 2],
    vec4f: [Float32Array, 4],
};

/**
 * Pack values into the buffer's content.
 *
 * @param {UniformLayout} layout
 * @param {Object<string, number | ArrayLike<number>>} values a number or the numbers of a vector per field
 * @returns {ArrayBuffer}
 * @throws {Error} a field's value is missing or has the wrong length
 */
export function pack({ size, fields }, values) {
    const content = new ArrayBuffer(size);
    for (const [name, { type, offset }] of Object.entries(fields)) {
        const [numbers, count] = TYPES[type];
        const value = typeof values[name] === "number" ? [values[name]] : values[name];
        if (value?.length !== count) {
            throw new Error(`uniform ${name}: found ${values[name]}, expected ${type}`);
        }
        new numbers(content, offset, count).set(value);
    }
    return content;
}
