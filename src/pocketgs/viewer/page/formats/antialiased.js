/**
 * Marks of scenes that were trained with Mip-Splatting's 2D filter; the twin of `formats/antialiased.py`.
 *
 * @module
 */

/** What a scene that is marked looks like here. */
export const TOO_OPAQUE = `trained with anti-aliasing, but drawn without: Gaussians smaller than a pixel are too opaque,
and the smaller the picture, the thicker fine things look`.replaceAll("\n", " ");

const MARKS = ["splatrendermode", "antialiased"];

/**
 * Whether comments of a `.ply` mark a scene: `SplatRenderMode: mip` (Brush) or `antialiased 1` (Postshot). The last of
 * such comments decides.
 *
 * @param {string[][]} lines of the header, as words
 * @returns {boolean}
 */
export function isMarked(lines) {
    const comments = lines.filter(([word]) => word === "comment").map(([, ...words]) => words.join(" ").toLowerCase());
    const pairs = comments.map((comment) => comment.replaceAll(":", " ").trim().split(/\s+/));
    const last = pairs.filter(([name, , rest]) => MARKS.includes(name) && rest === undefined).at(-1);
    return last !== undefined && ["mip", "1"].includes(last[1]);
}
