// What test_browser.py calls in the page.
import { openDevice } from "./webgpu/adapters.js";
import { Description } from "./webgpu/description.js";
import { Replayer } from "./webgpu/replay.js";
import { evaluate } from "./webgpu/sizes.js";

/** What the browser says about the shaders, and what it refuses of the pipelines. */
async function compile(json) {
    const description = new Description(json);
    const device = await openDevice();
    const messages = [];
    for (const [name, { source }] of Object.entries(description.shaders)) {
        const { messages: found } = await device.createShaderModule({ code: source }).getCompilationInfo();
        const lines = source.split("\n");
        messages.push(...found.map((one) => `${name}: ${one.type}: ${one.message}: ${lines[one.lineNum - 1]}`));
    }
    const errors = await errorsOf(device, () => new Replayer(device, description).prepare());
    device.destroy();
    return { messages, errors };
}

/**
 * Render a scene, train it, and say what became of it.
 *
 * @param {Object} job `description`; `given` numbers; `floats` and `words`, contents of buffers; the `view`'s fields,
 *     and for every step the `updates`' fields; `results`, from buffers to how many floats of them to read in the end
 */
async function train({ description: json, given, floats, words, view, updates, results }) {
    const description = new Description(json);
    const device = await openDevice();
    const replayer = new Replayer(device, description);
    const found = {};
    const errors = await errorsOf(device, async () => {
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
    });
    device.destroy();
    return { ...found, errors };
}

/** What goes wrong on a device meanwhile, in words. */
async function errorsOf(device, work) {
    const errors = [];
    device.addEventListener("uncapturederror", ({ error }) => errors.push(error.message));
    device.pushErrorScope("validation");
    await work().catch((error) => errors.push(error.message));
    const refused = await device.popErrorScope();
    return refused ? [refused.message, ...errors] : errors;
}

/** Values of expressions, or the errors they raise. */
function evaluateAll(expressions, symbols) {
    return expressions.map((expression) => {
        try {
            return evaluate(expression, symbols);
        } catch (error) {
            return error.message;
        }
    });
}

/** The error that opening the GPU, or asking it for a buffer, raises. */
async function refusal(json, sizes) {
    try {
        await new Replayer(await openDevice(), new Description(json)).reserve(sizes);
    } catch (error) {
        return error.message;
    }
    return null;
}

Object.assign(window, { compile, train, evaluateAll, refusal });
