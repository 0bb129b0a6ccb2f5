/**
 * How alike photographs look, by their features; the twin of `likeness` in `prior/features/pairs.py`.
 *
 * @module
 */

/**
 * Cosine similarity of the photographs' histograms of words, in which rare words count more (Sivic and Zisserman 2003).
 *
 * @param {ArrayLike<number>[]} found for each of F photographs the number of the word of each feature
 * @param {number} words how many there are
 * @returns {number[][]} (F, F)
 */
export function likeness(found, words) {
    const histograms = found.map((own) => {
        const histogram = new Float64Array(words);
        own.forEach((word) => (histogram[word] += 1));
        return histogram;
    });
    const holding = (word) => histograms.reduce((sum, histogram) => sum + (histogram[word] > 0), 0);
    const rarity = Float64Array.from({ length: words }, (_, word) => {
        return Math.log((1 + found.length) / (1 + holding(word)));
    });
    const rows = histograms.map((histogram) => {
        const weighted = histogram.map((count, word) => Math.sqrt(count) * rarity[word]);
        const length = Math.max(Math.sqrt(product(weighted, weighted)), 1e-12);
        return weighted.map((value) => value / length);
    });
    return rows.map((row) => rows.map((other) => product(row, other)));
}

const product = (one, other) => one.reduce((sum, value, i) => sum + value * other[i], 0);
