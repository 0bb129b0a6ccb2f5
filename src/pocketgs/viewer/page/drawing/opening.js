/**
 * Opening a GPU, and opening it again after it was lost.
 *
 * @module
 */

import { BUFFER_LIMITS, openDevice } from "../../gpu/device.js";

/** Tries to open a lost GPU, and milliseconds between them: a browser may have to start a process for it. */
export const TRIES = 3;
const PAUSE = 1000;

/**
 * Open a device, and make on it what it is needed for. Where that fails, the device does not stay open.
 *
 * @template T
 * @param {(device: GPUDevice) => Promise<T>} make
 * @returns {Promise<T>}
 * @throws {Error} there is no WebGPU, or no GPU, or what `make` throws
 */
export async function onDevice(make) {
    const device = await openDevice(BUFFER_LIMITS);
    try {
        return await make(device);
    } catch (error) {
        device.destroy();
        throw error;
    }
}

/**
 * Try to open a GPU several times.
 *
 * @template T
 * @param {() => Promise<T>} open
 * @param {number} tries
 * @returns {Promise<T>}
 * @throws {Error} that of the last try
 */
export async function tried(open, tries = TRIES) {
    for (;;) {
        try {
            return await open();
        } catch (error) {
            if (!--tries) {
                throw error;
            }
            await new Promise((resolve) => setTimeout(resolve, PAUSE));
        }
    }
}
