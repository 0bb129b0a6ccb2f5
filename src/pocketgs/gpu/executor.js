/**
 * Running passes in a browser; the twin of `executor.py`.
 *
 * @module
 */

import { BUFFER_LIMITS } from "./device.js";
import { evaluate } from "./sizes.js";
import { pack } from "./uniforms.js";

/**
 * @typedef {import("./description.js").Description} Description
 * @typedef {import("./sizes.js").Symbols} Symbols
 */

/** Maximum number of workgroups in one dimension of a dispatch. */
const MAX_ROW_LENGTH = 65_535;

/** Bytes of a write after which memory is worth a submission. */
const LARGE_WRITE = 1 << 20;

const FULL = "the GPU's memory is full: expected a smaller scene or smaller images";

/** Number of recorded sequences to keep: one per image size and amount of data. */
const MAX_RECORDED = 64;

const LAYOUT_TYPES = { uniform: "uniform", read: "read-only-storage", read_write: "storage" };

/** Holds a description's pipelines and buffers on a device. */
export class Executor {
    #device;
    #buffers = new Map();
    #layouts = new Map();
    #modules = new Map();
    #pipelines = new Map();
    #recordings = new Map();

    /**
     * @param {GPUDevice} device from `openDevice`
     * @param {Description} description what to run
     */
    constructor(device, description) {
        this.description = description;
        this.#device = device;
        const usage = GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST;
        for (const [label, { size }] of Object.entries(description.uniforms)) {
            this.#buffers.set(label, device.createBuffer({ label, size, usage }));
        }
    }

    /** Bytes of the largest buffer that a shader can use whole. */
    get largestBuffer() {
        return Math.min(...BUFFER_LIMITS.map((name) => this.#device.limits[name]));
    }

    /**
     * Compile pipelines without blocking the page, unlike `submit`, which compiles what is missing. Only as many
     * compile at a time as leave the page a processor, since the browser shows nothing new while all processors
     * compile.
     *
     * @param {Symbols | null} symbols numbers that decide which passes run; null to compile all
     * @throws {GPUPipelineError} the browser rejects a shader
     */
    async prepare(symbols = null) {
        const passes = Object.values(this.description.sequences)
            .flatMap((sequence) => sequence.passes)
            .filter(({ when }) => !symbols || evaluate(when, symbols));
        const wanted = [...new Map(passes.map((pass) => [pipelineKey(pass), pass]))];
        const compileOneByOne = async () => {
            while (wanted.length) {
                const [key, pass] = wanted.shift();
                this.#pipelines.set(key, await this.#device.createComputePipelineAsync(this.#stages(pass)));
            }
        };
        const atOnce = Math.max(1, (navigator.hardwareConcurrency || 2) - 1);
        await Promise.all(Array.from({ length: atOnce }, compileOneByOne));
    }

    /**
     * Allocate buffers of at least these sizes. A buffer that grows loses its content.
     *
     * @param {Object<string, number>} sizes bytes, from `Description.sizes`
     * @throws {Error} a buffer is larger than the device allows, or the GPU's memory is full
     */
    async reserve(sizes) {
        this.check(sizes);
        this.#device.pushErrorScope("out-of-memory");
        const grown = Object.entries(sizes).filter(([name, size]) => this.#grow(name, size));
        if (await this.#device.popErrorScope()) {
            // Any of them may be invalid, though it states the size that was asked for.
            grown.forEach(([name]) => this.#forget(name));
            throw new Error(FULL);
        }
    }

    /**
     * Check that the device allows buffers of these sizes.
     *
     * @param {Object<string, number>} sizes bytes, from `Description.sizes`
     * @throws {Error} it does not
     */
    check(sizes) {
        for (const [name, size] of Object.entries(sizes)) {
            if (size > this.largestBuffer) {
                throw new Error(
                    `the GPU's buffer '${name}' would need ${megabytes(size)} MB, the device allows ` +
                        `${megabytes(this.largestBuffer)} MB: expected a smaller scene or smaller images`,
                );
            }
        }
    }

    /** Bytes of all buffers of the description. */
    get bytes() {
        const names = Object.keys(this.description.buffers);
        return names.reduce((sum, name) => sum + (this.#buffers.get(name)?.size ?? 0), 0);
    }

    /**
     * A buffer, for passes that are not part of the description. It is replaced when it grows.
     *
     * @param {string} name
     * @returns {GPUBuffer}
     */
    buffer(name) {
        return this.#buffers.get(name);
    }

    /** Free the memory of all buffers of the description; `reserve` makes new ones. */
    free() {
        Object.keys(this.description.buffers).forEach((name) => this.#forget(name));
    }

    /** Free the GPU's memory; the executor cannot be used afterwards. */
    destroy() {
        this.#buffers.forEach((buffer) => buffer.destroy());
    }

    /**
     * Write to a buffer, in order with submitted sequences.
     *
     * @param {string} name
     * @param {BufferSource} content
     * @param {number} offset bytes
     */
    write(name, content, offset = 0) {
        this.#device.queue.writeBuffer(this.#buffers.get(name), offset, content);
        if (content.byteLength > LARGE_WRITE) {
            this.#device.queue.submit([]); // releases the browser's copy
        }
    }

    /**
     * Fill a buffer with zeros, in order with submitted sequences.
     *
     * @param {string} name
     */
    clear(name) {
        this.#submit(`clear ${name}`, [name], []);
    }

    /**
     * Set a uniform buffer.
     *
     * @param {string} name
     * @param {Object<string, number | ArrayLike<number>>} values see `pack`
     */
    writeUniform(name, values) {
        this.write(name, pack(this.description.uniforms[name], values));
    }

    /**
     * Read numbers. Waits until all submitted work is done.
     *
     * @template {Float32Array | Uint32Array} T
     * @param {string} name
     * @param {new (content: ArrayBuffer) => T} type
     * @param {number} count
     * @param {number} offset in numbers
     * @returns {Promise<T>}
     * @throws {Error} the GPU's memory is full
     */
    async read(name, type, count, offset = 0) {
        const usage = GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST;
        this.#device.pushErrorScope("out-of-memory");
        const copy = this.#device.createBuffer({ label: `copy of ${name}`, size: 4 * count, usage });
        const outOfMemory = this.#device.popErrorScope();
        // Submitted before anything is awaited: what is submitted meanwhile must not change what is read.
        this.#device.pushErrorScope("validation");
        const encoder = this.#device.createCommandEncoder();
        encoder.copyBufferToBuffer(this.#buffers.get(name), 4 * offset, copy, 0, 4 * count);
        this.#device.queue.submit([encoder.finish()]);
        const invalid = this.#device.popErrorScope();
        const mapped = copy.mapAsync(GPUMapMode.READ);
        const [full, fault] = await Promise.all([outOfMemory, invalid, mapped.catch(() => {})]);
        if (full || fault) {
            throw new Error(full ? FULL : fault.message);
        }
        await mapped;
        const content = new type(copy.getMappedRange().slice(0));
        copy.destroy();
        return content;
    }

    /**
     * Run a sequence without waiting for it.
     *
     * @param {string} name
     * @param {Symbols} symbols from `Description.symbols`
     */
    submit(name, symbols) {
        this.#submit(name, this.description.sequences[name].cleared, this.#recorded(name, symbols));
    }

    /**
     * Run a sequence pass by pass, each in a submission of its own, so that none takes long and others get their turns
     * on the GPU.
     *
     * @param {string} name
     * @param {Symbols} symbols from `Description.symbols`
     * @param {number} waits how often to wait until all is done that was submitted, the end included
     * @param {() => boolean} isWanted asked each time
     * @returns {Promise<boolean>} whether it ran to its end: it ends early once it is not wanted any more
     */
    async submitByPass(name, symbols, waits, isWanted) {
        const passes = this.#recorded(name, symbols);
        const atOnce = Math.ceil(passes.length / waits);
        this.#submit(name, this.description.sequences[name].cleared, []);
        for (let first = 0; first < passes.length; first += atOnce) {
            passes.slice(first, first + atOnce).forEach((pass) => this.#submit(name, [], [pass]));
            await this.finished();
            if (!isWanted()) {
                return false;
            }
        }
        return true;
    }

    /** Wait until all submitted work is done. */
    finished() {
        return this.#device.queue.onSubmittedWorkDone();
    }

    #submit(label, cleared, passes) {
        const encoder = this.#device.createCommandEncoder({ label });
        cleared.forEach((name) => encoder.clearBuffer(this.#buffers.get(name)));
        const compute = encoder.beginComputePass();
        for (const { pipeline, bindGroup, dispatch } of passes) {
            compute.setPipeline(pipeline);
            compute.setBindGroup(0, bindGroup);
            dispatch(compute);
        }
        compute.end();
        this.#device.queue.submit([encoder.finish()]);
    }

    /** Returns whether a new buffer took the place of one that was too small. */
    #grow(label, size) {
        if (this.#buffers.get(label)?.size >= size) {
            return false;
        }
        this.#forget(label);
        const { STORAGE, COPY_DST, COPY_SRC, INDIRECT } = GPUBufferUsage;
        const usage = STORAGE | COPY_DST | COPY_SRC | INDIRECT;
        this.#buffers.set(label, this.#device.createBuffer({ label, size, usage }));
        return true;
    }

    #forget(label) {
        this.#buffers.get(label)?.destroy();
        this.#buffers.delete(label);
        this.#recordings.clear();
    }

    /** A sequence with all names and sizes resolved, cached per size. */
    #recorded(name, symbols) {
        const key = JSON.stringify([name, symbols]);
        if (this.#recordings.size >= MAX_RECORDED && !this.#recordings.has(key)) {
            this.#recordings.clear();
        }
        return kept(this.#recordings, key, () => this.#record(this.description.sequences[name], symbols));
    }

    #record(sequence, symbols) {
        return sequence.passes
            .filter((pass) => evaluate(pass.when, symbols) && (pass.indirect || evaluate(pass.groups, symbols)))
            .map((pass) => ({
                pipeline: this.#pipeline(pass),
                bindGroup: this.#bindGroup(pass),
                dispatch: this.#dispatch(pass, symbols),
            }));
    }

    #dispatch(pass, symbols) {
        if (pass.indirect) {
            const [name, offset] = pass.indirect;
            const buffer = this.#buffers.get(name);
            return (compute) => compute.dispatchWorkgroupsIndirect(buffer, offset);
        }
        const groups = evaluate(pass.groups, symbols);
        const [across, down] = [Math.min(groups, MAX_ROW_LENGTH), Math.ceil(groups / MAX_ROW_LENGTH)];
        return (compute) => compute.dispatchWorkgroups(across, down);
    }

    #pipeline(pass) {
        return kept(this.#pipelines, pipelineKey(pass), () => this.#device.createComputePipeline(this.#stages(pass)));
    }

    #stages({ name, shader, constants }) {
        const code = this.description.shaders[shader].source;
        const module = kept(this.#modules, shader, () => this.#device.createShaderModule({ label: shader, code }));
        const layout = this.#device.createPipelineLayout({ bindGroupLayouts: [this.#layout(shader)] });
        return { label: name, layout, compute: { module, entryPoint: "main", constants } };
    }

    #layout(shader) {
        const entries = this.description.shaders[shader].bindings.map(({ access }, binding) => {
            return { binding, visibility: GPUShaderStage.COMPUTE, buffer: { type: LAYOUT_TYPES[access] } };
        });
        return kept(this.#layouts, shader, () => this.#device.createBindGroupLayout({ label: shader, entries }));
    }

    #bindGroup({ name, shader, buffers }) {
        const entries = this.description.shaders[shader].bindings.map(({ name: inShader }, binding) => {
            return { binding, resource: { buffer: this.#buffers.get(buffers[inShader] ?? inShader) } };
        });
        return this.#device.createBindGroup({ label: name, layout: this.#layout(shader), entries });
    }
}

/** The value of a key, made on first use. */
function kept(map, key, make) {
    if (!map.has(key)) {
        map.set(key, make());
    }
    return map.get(key);
}

function pipelineKey({ shader, constants }) {
    return JSON.stringify([shader, Object.entries(constants).sort()]);
}

function megabytes(bytes) {
    return Math.round(bytes / 1e6);
}
