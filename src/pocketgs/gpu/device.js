/**
 * Opening the browser's GPU; the twin of `device.py`.
 *
 * @module
 */

/** Limits that decide how large a scene may be. */
export const BUFFER_LIMITS = ["maxBufferSize", "maxStorageBufferBindingSize"];

/**
 * Open the browser's GPU, with the limits of WebGPU's core.
 *
 * @param {string[]} raised limits to take from the adapter instead, such as `BUFFER_LIMITS`
 * @returns {Promise<GPUDevice>}
 * @throws {Error} there is no WebGPU, or no GPU
 */
export async function openDevice(raised = []) {
    if (!globalThis.navigator?.gpu) {
        throw new Error("no WebGPU: expected a browser that has it, and a page from https or from localhost");
    }
    const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
    if (!adapter) {
        throw new Error("the browser offers no GPU: expected one that its WebGPU supports");
    }
    const requiredLimits = Object.fromEntries(raised.map((name) => [name, adapter.limits[name]]));
    return adapter.requestDevice({ requiredLimits });
}
