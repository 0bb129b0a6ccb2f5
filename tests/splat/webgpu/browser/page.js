// What test_browser.py calls in the page.
import { openDevice } from "./webgpu/adapters.js";
import { Description } from "./webgpu/description.js";
import { Replayer } from "./webgpu/replay.js";
import { evaluate } from "./webgpu/sizes.js";

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
    const replayer = new Replayer(device, description);
    await replayer.prepare().catch((error) => complaints.push(error.message));

    const found = { complaints };
    const symbols = description.symbols(given);
    await replayer.reserve(description.sizes(symbols));
    Object.entries(floats).forEach(([name, values]) => replayer.write(name, new Float32Array(values)));
    Object.entries(words).forEach(([name, values]) => replayer.write(name, new Uint32Array(values)));
    replayer.writeUniform("view", view);
    replayer.submit("render", symbols);
    found.image = Array.from(await replayer.read("image", Float32Array, 4 * symbols.pixels));
    for (const update of updates) {
        replayer.writeUniform("update", update);
        replayer.submit("step", symbols);
    }
    found.status = Array.from(await replayer.read("status", Uint32Array, 3));
    for (const [name, count] of Object.entries(results)) {
        found[name] = Array.from(await replayer.read(name, Float32Array, count));
    }
    device.destroy();
    return found;
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
    await new Replayer(await openDevice(), new Description(json)).reserve(sizes);
}

Object.assign(window, { replay, evaluateAll, reserve });
