/**
 * Storage that the browser keeps until the user deletes it: what it keeps otherwise goes when the disk is nearly full.
 *
 * @module
 */

/** Ask for it; some browsers ask the user. @returns {Promise<boolean>} whether what the page keeps will last */
export async function askForLastingStorage() {
    try {
        return await navigator.storage.persist();
    } catch {
        return false; // an old browser, or a page that may keep nothing
    }
}
