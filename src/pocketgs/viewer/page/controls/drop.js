/**
 * Opening a scene from the user's disk: dropped on the page, or chosen.
 *
 * @module
 */

/**
 * Listen for files.
 *
 * @param {(file: File) => void} onFile
 */
export function listenForFiles(onFile) {
    const [hint, input] = [document.getElementById("drop"), document.getElementById("file")];
    const takeFirst = (files) => files?.length && onFile(files[0]);
    window.addEventListener("dragover", (event) => {
        event.preventDefault();
        hint.hidden = false;
    });
    window.addEventListener("dragleave", (event) => {
        // The pointer has left the page.
        hint.hidden = event.relatedTarget === null;
    });
    window.addEventListener("drop", (event) => {
        event.preventDefault();
        hint.hidden = true;
        takeFirst(event.dataTransfer?.files);
    });
    input.addEventListener("change", () => {
        takeFirst(input.files);
        input.value = "";
    });
    document.getElementById("open").addEventListener("click", () => input.click());
}
