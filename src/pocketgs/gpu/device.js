/**
 * Opening the browser's GPU; the twin of `device.py`.
 *
 * @module
 */

/** Limits that decide how large a scene may be. */
export const BUFFER_LIMITS = ["maxBufferSize", "maxStorageBufferBindingSize"];

/**
 * Open the browser's GPU with WebGPU's default limits.
 *
 * @param {string[]} raised limits to raise to the adapter's, such as `BUFFER_LIMITS`
 * @returns {Promise<GPUDevice>}
 * @throws {Error} there is no WebGPU, or no GPU
 */
export async function openDevice(raised = []) {
    if (!globalThis.navigator?.gpu) {
        throw new Error("no WebGPU: expected a browser that supports it, and a page from https or localhost");
    }
    const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
    if (!adapter) {
        throw new Error("the browser offers no GPU: expected one that WebGPU supports");
    }
    const requiredLimits = Object.fromEntries(raised.map((name) => [name, adapter.limits[name]]));
    return adapter.requestDevice({ requiredLimits });
}
