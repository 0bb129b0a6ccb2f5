/**
 * Images of any number of channels in another size, as OpenCV computes them.
 *
 * @module
 */

/** @typedef {{width: number, height: number}} Size */

/**
 * Average areas (OpenCV's INTER_AREA).
 *
 * @param {ArrayLike<number>} values (H, W, channels)
 * @param {number} channels
 * @param {Size} before
 * @param {Size} after
 * @returns {Float32Array} (H', W', channels)
 */
export function areaAveraged(values, channels, before, after) {
    const [across, down] = [sharesOf(before.width, after.width), sharesOf(before.height, after.height)];
    const result = new Float32Array(channels * after.width * after.height);
    const line = new Float32Array(channels * before.width);
    down.forEach(({ first, weights }, row) => {
        line.fill(0);
        weights.forEach((weight, i) => {
            const begin = line.length * (first + i);
            for (let at = 0; at < line.length; at++) {
                line[at] += weight * values[begin + at];
            }
        });
        across.forEach((shares, column) => {
            for (let channel = 0; channel < channels; channel++) {
                let sum = 0;
                for (let i = 0; i < shares.weights.length; i++) {
                    sum += shares.weights[i] * line[channels * (shares.first + i) + channel];
                }
                result[channels * (row * after.width + column) + channel] = sum;
            }
        });
    });
    return result;
}

/**
 * Interpolate between the nearest pixels (OpenCV's INTER_LINEAR).
 *
 * @param {ArrayLike<number>} values (H, W)
 * @param {Size} before
 * @param {Size} after
 * @returns {Float32Array} (H', W')
 */
export function interpolated(values, before, after) {
    const [across, down] = [placesOf(before.width, after.width), placesOf(before.height, after.height)];
    const result = new Float32Array(after.width * after.height);
    down.forEach(([above, below, share], row) => {
        const along = (from, [left, right, part]) => {
            const begin = from * before.width;
            return (1 - part) * values[begin + left] + part * values[begin + right];
        };
        across.forEach((places, column) => {
            const value = (1 - share) * along(above, places) + share * along(below, places);
            result[row * after.width + column] = value;
        });
    });
    return result;
}

/** For each of the new pixels along a side, the first old one that it covers, and by how much it covers each. */
function sharesOf(before, after) {
    const scale = before / after;
    return Array.from({ length: after }, (_, i) => {
        const [low, high] = [i * scale, Math.min((i + 1) * scale, before)];
        const first = Math.floor(low + 1e-9);
        const count = Math.max(1, Math.ceil(high - 1e-9) - first);
        const weights = Array.from({ length: count }, (_, j) => {
            return (Math.min(high, first + j + 1) - Math.max(low, first + j)) / (high - low);
        });
        return { first, weights };
    });
}

/** For each of the new pixels along a side, the two old ones that its middle lies between, and the second's share. */
function placesOf(before, after) {
    return Array.from({ length: after }, (_, i) => {
        const place = Math.min(Math.max(((i + 0.5) * before) / after - 0.5, 0), before - 1);
        const first = Math.floor(place);
        return [first, Math.min(first + 1, before - 1), place - first];
    });
}
