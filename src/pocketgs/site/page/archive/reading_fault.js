/**
 * Why content could not be read though it may be sound: the system gives it no more, or there is no memory for it.
 *
 * @module
 */

const AWAY = "cannot be read any more: the system may have moved it, such as to the cloud; choose it once more";
const TOO_LARGE = "does not fit into the browser's memory: close other tabs, or choose a smaller capture";

/** By the names of what browsers throw. */
const REASONS = { NotReadableError: AWAY, NotFoundError: AWAY, RangeError: TOO_LARGE, QuotaExceededError: TOO_LARGE };

/**
 * What to say of a file after an error while it was read.
 *
 * @param {Error} error
 * @returns {string | null} null if its content is to blame
 */
export const readingFault = ({ name }) => REASONS[name] ?? null;
