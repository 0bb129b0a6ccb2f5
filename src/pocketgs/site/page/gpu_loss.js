/**
 * Work on a GPU that may be lost.
 *
 * @module
 */

/** What a lost GPU makes fail fails first: let its loss be told before. */
const MS_UNTIL_LOSS_IS_TOLD = 500;

/**
 * Watches a device. `Promise.race` with the device's own promise would in many browsers keep in memory what work has
 * resolved to, for as long as there is the device.
 */
export class GpuLoss {
    /** @type {string | null} why the GPU was lost */
    #reason = null;
    #listeners = new Set();

    /** @param {GPUDevice} device */
    constructor(device) {
        device.lost.then(({ message }) => {
            this.#reason = message.replace(/\.$/, "") || "the browser gives no reason";
            this.#listeners.forEach((listener) => listener());
        });
    }

    /** End work that nobody waits for any more. @throws {Error} the GPU was lost */
    throwIfLost() {
        if (this.#reason !== null) {
            throw new Error(`The GPU was lost: ${this.#reason}`);
        }
    }

    /**
     * The result of work, unless the GPU is lost before.
     *
     * @template T
     * @param {Promise<T>} work
     * @param {() => string} advise what to do, called once it is lost
     * @returns {Promise<T>}
     * @throws {Error} the work's own, or that the GPU was lost
     */
    unless(work, advise) {
        return new Promise((resolve, reject) => {
            const onLoss = () => reject(new Error(`The GPU was lost: ${this.#reason}. ${advise()}`));
            this.#listeners.add(onLoss);
            work.catch(thrownLater)
                .then(resolve, reject)
                .finally(() => this.#listeners.delete(onLoss));
            if (this.#reason !== null) {
                onLoss();
            }
        });
    }
}

async function thrownLater(error) {
    await new Promise((resolve) => setTimeout(resolve, MS_UNTIL_LOSS_IS_TOLD));
    throw error;
}
