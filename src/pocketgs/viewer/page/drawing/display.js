/**
 * Draws a rendered image from its buffer to a canvas.
 *
 * @module
 */

import { COUNT_DEPTHS, DRAW, FIND_DEPTH_RANGE } from "./display_shaders.js";

const HISTOGRAM_BYTES = 4 * 256;
const UNIFORM_BYTES = 48;
const COUNTING_GROUPS = 64;

/** Draws on one canvas. */
export class Display {
    #device;
    #context;
    #pipelines;
    #uniform;
    #histogram;
    #range;

    /**
     * Compile the shaders.
     *
     * @param {GPUDevice} device
     * @param {HTMLCanvasElement} canvas
     * @returns {Promise<Display>}
     */
    static async open(device, canvas) {
        const display = new Display();
        const format = navigator.gpu.getPreferredCanvasFormat();
        display.#device = device;
        display.#context = canvas.getContext("webgpu");
        display.#context.configure({ device, format, alphaMode: "opaque" });
        const { UNIFORM, STORAGE, COPY_DST } = GPUBufferUsage;
        display.#uniform = device.createBuffer({ label: "display", size: UNIFORM_BYTES, usage: UNIFORM | COPY_DST });
        display.#histogram = device.createBuffer({ label: "depths", size: HISTOGRAM_BYTES, usage: STORAGE | COPY_DST });
        display.#range = device.createBuffer({ label: "depth range", size: 8, usage: STORAGE });
        const [count, find, draw] = await Promise.all([
            computePipeline(device, "count depths", COUNT_DEPTHS),
            computePipeline(device, "find depth range", FIND_DEPTH_RANGE),
            drawPipeline(device, format),
        ]);
        display.#pipelines = { count, find, draw };
        return display;
    }

    /**
     * Draw over the whole canvas.
     *
     * @param {GPUBuffer} image RGB and transmittance of every pixel, row by row; as depths, Σ α T depth in place of RGB
     * @param {{width: number, height: number}} size of the image
     * @param {{width: number, height: number}} canvas
     * @param {Object} how
     * @param {[number, number, number]} how.background RGB
     * @param {boolean} how.asDepth
     * @param {number} how.near the least depth that is drawn
     */
    show(image, size, canvas, { background, asDepth, near }) {
        const values = new ArrayBuffer(UNIFORM_BYTES);
        new Float32Array(values, 0, 4).set([...background, 1]);
        new Uint32Array(values, 16, 5).set([size.width, size.height, canvas.width, canvas.height, Number(asDepth)]);
        new Float32Array(values, 36, 1).set([near]);
        this.#device.queue.writeBuffer(this.#uniform, 0, values);
        const [uniform, histogram, range] = [this.#uniform, this.#histogram, this.#range].map((buffer) => ({ buffer }));
        const pixels = { buffer: image, size: 16 * size.width * size.height };
        const encoder = this.#device.createCommandEncoder({ label: "display" });
        if (asDepth) {
            encoder.clearBuffer(this.#histogram);
            const pass = encoder.beginComputePass();
            this.#dispatch(pass, this.#pipelines.count, [uniform, pixels, histogram], COUNTING_GROUPS);
            this.#dispatch(pass, this.#pipelines.find, [histogram, range], 1);
            pass.end();
        }
        const view = this.#context.getCurrentTexture().createView();
        const pass = encoder.beginRenderPass({ colorAttachments: [{ view, loadOp: "clear", storeOp: "store" }] });
        pass.setPipeline(this.#pipelines.draw);
        pass.setBindGroup(0, this.#bindGroup(this.#pipelines.draw, [uniform, pixels, range]));
        pass.draw(3);
        pass.end();
        this.#device.queue.submit([encoder.finish()]);
    }

    #dispatch(pass, pipeline, resources, groups) {
        pass.setPipeline(pipeline);
        pass.setBindGroup(0, this.#bindGroup(pipeline, resources));
        pass.dispatchWorkgroups(groups);
    }

    #bindGroup(pipeline, resources) {
        const entries = resources.map((resource, binding) => ({ binding, resource }));
        return this.#device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
    }
}

function computePipeline(device, label, code) {
    const module = device.createShaderModule({ label, code });
    return device.createComputePipelineAsync({ label, layout: "auto", compute: { module } });
}

function drawPipeline(device, format) {
    const module = device.createShaderModule({ label: "display", code: DRAW });
    const vertex = { module, entryPoint: "cover" };
    const fragment = { module, entryPoint: "colour", targets: [{ format }] };
    return device.createRenderPipelineAsync({ label: "display", layout: "auto", vertex, fragment });
}
