"""Semi-global matching: aggregate a cost volume along straight paths and select the winners (Hirschmüller 2008)."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.prior.depth.sweep_constants import EDGE, NOISE, OUT_OF_REACH, RIVAL_DISTANCE
from pocketgs.system.compile import parallel_kernel, part

FOUR_PATHS = np.array([(0, 1), (0, -1), (1, 0), (-1, 0)], np.int64)
EIGHT_PATHS = np.concatenate([FOUR_PATHS, np.array([(1, 1), (-1, -1), (1, -1), (-1, 1)], np.int64)])
"""(row, column) steps of the paths."""

STRIPS = 64
"""Number of strips of neighbouring paths that are distributed to threads."""

BEYOND = np.int16(OUT_OF_REACH)


@parallel_kernel
def aggregate(costs: np.ndarray, view: np.ndarray, paths: np.ndarray, small_step: int, large_step: int) -> np.ndarray:
    """Sum, over all paths, the minimum cost of reaching each pixel and hypothesis along the path.

    Paths of one direction never meet: threads share them out and never write to the same sum.

    Args:
        costs: (H, W, D) uint8.
        view: (H, W) uint8 greyscale image: depth changes are cheaper where the grey level changes.
        paths: (P, 2) int64 steps.
        small_step: penalty P1 of a change by one hypothesis.
        large_step: penalty P2 of any larger change, between pixels of the same grey.

    Returns:
        (H, W, D) uint16.
    """
    height, width, hypotheses = costs.shape
    total = np.zeros((height, width, hypotheses), np.uint16)
    for path in range(len(paths)):
        down, across = paths[path]
        lines, length = lines_of(down, across, height, width)
        for strip in prange(STRIPS):
            first, last = lines * strip // STRIPS, lines * (strip + 1) // STRIPS
            reached = np.full((last - first, hypotheses + 2), BEYOND)
            least = np.zeros(last - first, np.int16)
            for step in range(length):
                for line in range(first, last):
                    row, column = place_on_line(line, step, down, across, height, width)
                    if column < 0 or column >= width:
                        continue
                    own, sums = costs[row, column], total[row, column]
                    row_before, column_before = row - down, column - across
                    if row_before < 0 or row_before >= height or column_before < 0 or column_before >= width:
                        least[line - first] = begin(own, reached[line - first], sums)
                        continue
                    edge = abs(np.int64(view[row, column]) - np.int64(view[row_before, column_before]))
                    jump = max(small_step, large_step * EDGE // (EDGE + edge))
                    least[line - first] = extend(
                        own, reached[line - first], least[line - first], np.int16(small_step), np.int16(jump), sums
                    )
    return total


@part
def lines_of(down: int, across: int, height: int, width: int) -> tuple[int, int]:
    """Number of lines of one direction that cross the image, and steps along each."""
    if down == 0:
        return height, width
    return (width if across == 0 else width + height - 1), height


@part
def place_on_line(line: int, step: int, down: int, across: int, height: int, width: int) -> tuple[int, int]:
    """Row and column of a step along a line; oblique lines are outside the image for some steps."""
    if down == 0:
        return line, (step if across > 0 else width - 1 - step)
    row = step if down > 0 else height - 1 - step
    if across == 0:
        return row, line
    column = line - (height - 1) + step
    return row, (column if across > 0 else width - 1 - column)


@part
def begin(costs: np.ndarray, reached: np.ndarray, total: np.ndarray) -> np.int16:
    """Start a path: L(d) = C(d). Returns min L."""
    least = BEYOND
    for d in range(len(costs)):
        value = np.int16(costs[d])
        reached[d + 1] = value
        total[d] += np.uint16(value)
        least = np.int16(min(least, value))
    return least


@part
def extend(
    costs: np.ndarray,
    reached: np.ndarray,
    least: np.int16,
    small_step: np.int16,
    large_step: np.int16,
    total: np.ndarray,
) -> np.int16:
    """Extend a path by one pixel: L(d) = C(d) + min(L'(d), L'(d ± 1) + P1, min L' + P2) - min L' (equation 13).

    `reached` holds L', padded with sentinels at both ends, and is overwritten with L. Casts keep the arithmetic in 16
    bits, 32 per vector. Returns min L.
    """
    hypotheses = len(costs)
    far = np.int16(least + large_step)
    fresh = np.empty(hypotheses, np.int16)
    below, here, above = reached[:hypotheses], reached[1 : hypotheses + 1], reached[2:]
    for d in range(hypotheses):
        near = np.int16(min(below[d], above[d]) + small_step)
        fresh[d] = np.int16(np.int16(costs[d]) + np.int16(min(min(here[d], near), far) - least))
    smallest = BEYOND
    for d in range(hypotheses):
        value = fresh[d]
        here[d] = value
        total[d] += np.uint16(value)
        smallest = np.int16(min(smallest, value))
    return smallest


@parallel_kernel
def winners(total: np.ndarray, inverse_depths: np.ndarray, paths: int) -> tuple[np.ndarray, np.ndarray]:
    """The cheapest hypothesis per pixel with sub-step precision, and its margin.

    A parabola through the winner and its neighbours gives the fraction. A winner at the near end of the range is
    rejected: the true depth may be outside. At the far end it is the first hypothesis itself; the caller decides.

    Args:
        total: (H, W, D) uint16 aggregated costs.
        inverse_depths: (D,) float32 hypotheses, evenly spaced.
        paths: number of paths that costs were summed over.

    Returns:
        (H, W) float32 depths, 0 without a winner, and (H, W) float32 margins in [0, 1]: the share by which the winner
        is cheaper than its best rival.
    """
    height, width, hypotheses = total.shape
    depths, margins = np.zeros((2, height, width), np.float32)
    spacing = inverse_depths[1] - inverse_depths[0]
    for row in prange(height):
        for column in range(width):
            costs = total[row, column]
            best = 0
            for d in range(hypotheses):
                if costs[d] < costs[best]:
                    best = d
            if best == hypotheses - 1:
                continue
            rival = np.uint16(65535)
            for d in range(hypotheses):
                if abs(d - best) > RIVAL_DISTANCE:
                    rival = min(rival, costs[d])
            # If all hypotheses cost the same, there is no winner.
            if best == 0 and rival == costs[0]:
                continue
            least, high = np.float32(costs[best]), np.float32(costs[best + 1])
            low = np.float32(costs[best - 1]) if best > 0 else high
            curvature = low - 2 * least + high
            fraction = np.float32(0.5) * (low - high) / curvature if curvature > 0 else np.float32(0.0)
            depths[row, column] = 1 / (inverse_depths[best] + fraction * spacing)
            margins[row, column] = (np.float32(rival) - least) / max(np.float32(rival), np.float32(NOISE * paths))
    return depths, margins
