/**
 * Saving a file: by the system's share sheet on phones, where there is one, else as a download.
 *
 * @module
 */

/** How long a download may take to begin, in milliseconds. */
const UNTIL_TAKEN = 60_000;

/**
 * Save a file. To be called by a click, without which browsers share nothing.
 *
 * @param {Blob} content
 * @param {string} name of the file
 */
export async function save(content, name) {
    const file = new File([content], name, { type: content.type || "application/octet-stream" });
    const isPhone = matchMedia("(pointer: coarse)").matches;
    if (isPhone && navigator.canShare?.({ files: [file] }) && (await isShared(file))) {
        return;
    }
    const link = document.createElement("a");
    link.href = URL.createObjectURL(file);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), UNTIL_TAKEN);
}

/** Whether the user was asked where to, even if the answer was nowhere. */
async function isShared(file) {
    try {
        await navigator.share({ files: [file], title: file.name });
        return true;
    } catch ({ name }) {
        // Systems refuse kinds of files that they do not know, some of them only now.
        return name === "AbortError";
    }
}
