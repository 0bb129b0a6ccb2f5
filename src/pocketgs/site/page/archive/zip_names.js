/**
 * The names in zip files as they were meant, where programs write others than the format asks for; the twin of `_name` in
 * `serve/archive.py`.
 *
 * @module
 */

/** The flag of names in UTF-8. Many programs write these without it. */
const IS_UTF8 = 1 << 11;

/** Code page 437 from 128 on: what the format says of names without the flag, and Windows writes. */
const UPPER =
    "ÇüéâäàåçêëèïîìÄÅÉæÆôöòûùÿÖÜ¢£¥₧ƒáíóúñÑªº¿⌐¬½¼¡«»░▒▓│┤╡╢╖╕╣║╗╝╜╛┐" +
    "└┴┬├─┼╞╟╚╔╩╦╠═╬╧╨╤╥╙╘╒╓╫╪┘┌█▄▌▐▀αßΓπΣσµτΦΘΩδ∞φε∩≡±≥≤⌠⌡÷≈°∙·√ⁿ²■\u00a0";

/** What some programs begin all names with, such as bsdtar. */
const HERE = /^(\.\/)+(?=[^/])/;

/**
 * @param {{name: Uint8Array, flags: number}[]} entries
 * @returns {string[] | null} a path for each; null if one is not what its flag says
 */
export function pathsOf(entries) {
    const paths = entries.map(decoded);
    if (paths.includes(null)) {
        return null;
    }
    // Old tools on Windows separate folders by backslashes.
    const isOld = !paths.some((path) => path.includes("/"));
    return paths.map((path) => (isOld ? path.replaceAll("\\", "/") : path).replace(HERE, ""));
}

function decoded({ name, flags }) {
    try {
        return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(name);
    } catch {
        const letter = (byte) => (byte < 128 ? String.fromCharCode(byte) : UPPER[byte - 128]);
        return flags & IS_UTF8 ? null : Array.from(name, letter).join("");
    }
}
