// What test_browser.py calls in the page.
import { openDevice } from "./gpu/device.js";
import { Description } from "./gpu/description.js";
import { Executor } from "./gpu/executor.js";
import { evaluate } from "./gpu/sizes.js";

/**
 * Render a scene, train it, and say what became of it and what the browser has to complain of.
 *
 * @param {Object} job `description`; `given` numbers; `floats` and `words`, contents of buffers; the `view`'s fields,
 *     and for every step the `updates`' fields; `results`, from buffers to how many floats to read of them in the end
 */
async function replay({ description: json, given, floats, words, view, updates, results }) {
    const description = new Description(json);
    const device = await openDevice();
    const complaints = await shaderErrors(device, description.shaders);
    device.addEventListener("uncapturederror", ({ error }) => complaints.push(error.message));
    const executor = new Executor(device, description);
    await executor.prepare().catch((error) => complaints.push(error.message));

    const found = { complaints };
    const symbols = description.symbols(given);
    await executor.reserve(description.sizes(symbols));
    Object.entries(floats).forEach(([name, values]) => executor.write(name, new Float32Array(values)));
    Object.entries(words).forEach(([name, values]) => executor.write(name, new Uint32Array(values)));
    executor.writeUniform("view", view);
    executor.submit("render", symbols);
    found.image = Array.from(await executor.read("image", Float32Array, 4 * symbols.pixels));
    for (const update of updates) {
        executor.writeUniform("update", update);
        executor.submit("step", symbols);
    }
    found.status = Array.from(await executor.read("status", Uint32Array, 3));
    for (const [name, count] of Object.entries(results)) {
        found[name] = Array.from(await executor.read(name, Float32Array, count));
    }
    device.destroy();
    return found;
}

/**
 * Run a sequence on given content, and say what became of it and what the browser has to complain of.
 *
 * @param {Object} job `description`; `given` numbers; `sequence`; `floats` and `words`, contents of buffers; `uniforms`,
 *     fields by uniform; `results`, from buffers to how many floats to read of them in the end
 */
async function runSequence({ description: json, given, sequence, floats, words, uniforms, results }) {
    const description = new Description(json);
    const device = await openDevice();
    const complaints = await shaderErrors(device, description.shaders);
    device.addEventListener("uncapturederror", ({ error }) => complaints.push(error.message));
    const executor = new Executor(device, description);
    const symbols = description.symbols(given);
    await executor.reserve(description.sizes(symbols));
    Object.entries(floats).forEach(([name, values]) => executor.write(name, new Float32Array(values)));
    Object.entries(words).forEach(([name, values]) => executor.write(name, new Uint32Array(values)));
    Object.entries(uniforms).forEach(([name, values]) => executor.writeUniform(name, values));
    executor.submit(sequence, symbols);
    const found = {};
    for (const [name, count] of Object.entries(results)) {
        found[name] = Array.from(await executor.read(name, Float32Array, count));
    }
    device.destroy();
    return { ...found, complaints };
}

/** Compile every pass on a device with the least limits and no features; say what the browser has to complain of. */
async function compileAll(json) {
    const device = await (await navigator.gpu.requestAdapter()).requestDevice();
    const limits = ["maxStorageBuffersPerShaderStage", "maxStorageBufferBindingSize", "maxComputeWorkgroupStorageSize"];
    const complaints = [];
    device.addEventListener("uncapturederror", ({ error }) => complaints.push(error.message));
    await new Executor(device, new Description(json)).prepare().catch((error) => complaints.push(error.message));
    device.destroy();
    return { complaints, limits: limits.map((name) => device.limits[name]) };
}

/** What the browser refuses of the shaders, and in which lines. */
async function shaderErrors(device, shaders) {
    const messages = [];
    for (const [name, { source }] of Object.entries(shaders)) {
        const information = await device.createShaderModule({ code: source }).getCompilationInfo();
        const errors = information.messages.filter(({ type }) => type === "error");
        messages.push(...errors.map(({ message, lineNum }) => `${name}: ${message}: ${source.split("\n")[lineNum - 1]}`));
    }
    return messages;
}

/** Values of expressions. */
function evaluateAll(expressions, symbols) {
    return expressions.map((expression) => evaluate(expression, symbols));
}

/** Open the GPU and ask it for buffers. */
async function reserve(json, sizes) {
    await new Executor(await openDevice(), new Description(json)).reserve(sizes);
}

Object.assign(window, { compileAll, replay, runSequence, evaluateAll, reserve });
