/**
 * Numbers at equal distances.
 *
 * @module
 */

/** As `numpy.linspace`. @type {(first: number, last: number, count: number) => number[]} */
export function evenly(first, last, count) {
    const step = (last - first) / (count - 1);
    return Array.from({ length: count }, (_, i) => (i > 0 && i === count - 1 ? last : first + (i ? i * step : 0)));
}

/** At most so many whole numbers below `count`; the twin of `evenly_chosen` in `capture/even_choice.py`. */
export const evenlyChosen = (count, most) => evenly(0, count - 1, Math.min(most, count)).map(Math.trunc);
