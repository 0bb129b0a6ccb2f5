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
 * @returns {Promise<boolean>} whether it is shared or downloaded: false where the user has cancelled that
 */
export async function save(content, name) {
    const file = new File([content], name, { type: content.type || "application/octet-stream" });
    const isPhone = matchMedia("(pointer: coarse)").matches;
    if (isPhone && navigator.canShare?.({ files: [file] })) {
        const outcome = await shared(file);
        if (outcome !== "refused") {
            return outcome === "shared";
        }
    }
    const link = document.createElement("a");
    link.href = URL.createObjectURL(file);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), UNTIL_TAKEN);
    return true;
}

/** @returns {Promise<"shared" | "cancelled" | "refused">} by the user or the system */
async function shared(file) {
    try {
        await navigator.share({ files: [file], title: file.name });
        return "shared";
    } catch ({ name }) {
        // Systems refuse kinds of files that they do not know, some of them only now.
        return name === "AbortError" ? "cancelled" : "refused";
    }
}
