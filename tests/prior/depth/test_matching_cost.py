"""Matching costs: the kernel against plain NumPy, and the invariances of the census."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.prior.depth.cpu.matching_cost import SourceViews, matching_costs, squares_of
from pocketgs.prior.depth.sweep_constants import BITS, RADIUS

HEIGHT, WIDTH = 19, 23
INVERSE_DEPTHS = np.linspace(0.2, 1.0, 9, dtype=np.float32)
FOCAL = 20.0


def noise(*shape: int, seed: int = 0, most: int = 256) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, most, shape, dtype=np.uint8)


def source_views(*images: np.ndarray, turns: list[np.ndarray], shifts: list[list[float]]) -> SourceViews:
    """Padded with noise, which no cost may depend on."""
    sizes = np.array([image.shape for image in images])
    squares = noise(len(images), *sizes.max(axis=0), seed=99).astype(np.uint32)
    for place, image in zip(squares, images, strict=True):
        place[: image.shape[0], : image.shape[1]] = squares_of(image)
    return SourceViews(squares, sizes.astype(np.float32), np.array(turns, np.float32), np.array(shifts, np.float32))


def turned(degrees: list[float], width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """K R K⁻¹ of a camera that has only turned."""
    intrinsics = np.array([[FOCAL, 0, width / 2], [0, FOCAL, height / 2], [0, 0, 1]])
    return np.asarray(
        intrinsics @ Rotation.from_euler("xyz", degrees, degrees=True).as_matrix() @ np.linalg.inv(intrinsics)
    )


def twin(view: np.ndarray, among: SourceViews, inverse_depths: np.ndarray) -> np.ndarray:
    """The costs by the definition of `matching_costs`, also in float32: a census flips if two samples nearly agree."""
    height, width = view.shape
    own = census(np.pad(view, RADIUS, mode="edge"))
    costs = np.empty((height, width, len(inverse_depths)), np.uint8)
    for hypothesis, inverse_depth in enumerate(inverse_depths):
        counts = []
        for squares, size, turn, shift in zip(*among[:4], strict=True):
            image = (squares[: int(size[0]), : int(size[1])] & 255).astype(np.float32)
            warped, visible = warp(image, turn, shift * inverse_depth, height, width)
            count = np.sum(census(warped) != own, axis=0).astype(float)
            counts.append(np.where(visible[RADIUS:-RADIUS, RADIUS:-RADIUS], count, np.nan))
        best = np.sort(counts, axis=0)[:2]
        seen = ~np.isnan(best)
        mean = np.sum(np.where(seen, best, 0), axis=0) // np.maximum(seen.sum(axis=0), 1)
        costs[:, :, hypothesis] = np.where(seen.any(axis=0), mean, BITS // 2)
    return costs


def census(padded: np.ndarray) -> np.ndarray:
    """(BITS, H, W) bool: which neighbours are darker."""
    height, width = np.array(padded.shape) - 2 * RADIUS
    side = range(2 * RADIUS + 1)
    around = [padded[y : y + height, x : x + width] for y in side for x in side]
    middle = around.pop(BITS // 2)
    return np.array(around) < middle


def warp(
    image: np.ndarray, turn: np.ndarray, shift: np.ndarray, height: int, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """The image where the view's pixels, and some around it, fall; and whether they fall inside it."""
    half = np.float32(0.5)
    y, x = np.mgrid[-RADIUS : height + RADIUS, -RADIUS : width + RADIUS].astype(np.float32) + half
    u, v, w = (turn[row, 0] * x + (turn[row, 1] * y + turn[row, 2] + shift[row]) for row in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        across, down = u / w, v / w
    visible = (w > 0) & (across >= 0) & (across < image.shape[1]) & (down >= 0) & (down < image.shape[0])
    # What falls outside is a neighbour at most: the border is continued.
    column = np.clip(np.nan_to_num(across - half), 0, np.float32(image.shape[1] - 1))
    row = np.clip(np.nan_to_num(down - half), 0, np.float32(image.shape[0] - 1))
    continued = np.pad(image, (0, 1), mode="edge")
    left, above = column.astype(int), row.astype(int)
    right_share, below_share = column - left.astype(np.float32), row - above.astype(np.float32)

    def between(rows: np.ndarray) -> np.ndarray:
        first, second = continued[rows, left], continued[rows, left + 1]
        return np.asarray(first + (second - first) * right_share)

    upper, lower = between(above), between(above + 1)
    return np.floor(upper + (lower - upper) * below_share + half).astype(np.uint8), visible


STILL = np.eye(3)
SIDEWAYS = [[3.0, 0.0, 0.0], [-4.0, 1.0, 0.0], [0.5, 6.0, 0.0]]
CASES = {
    "one source view": source_views(noise(HEIGHT, WIDTH, seed=1), turns=[STILL], shifts=[[5.3, 0.7, 0]]),
    "three source views": source_views(*noise(3, HEIGHT, WIDTH, seed=1), turns=[STILL] * 3, shifts=SIDEWAYS),
    "two source views": source_views(*noise(2, HEIGHT, WIDTH, seed=1), turns=[STILL] * 2, shifts=SIDEWAYS[:2]),
    "rotation": source_views(
        *noise(3, HEIGHT, WIDTH, seed=1),
        turns=[turned([3, -5, 10]), turned([0, 0, 90]), turned([-20, 4, 0])],
        shifts=[[2.0, 1.0, 0.05], [-3.0, 0.0, -0.3], [0.0, 2.0, 0.2]],
    ),
    "sizes": source_views(
        noise(30, 14, seed=1),
        noise(12, 40, seed=2),
        noise(2, 2, seed=3),
        turns=[STILL, turned([0, 0, 5]), STILL],
        shifts=SIDEWAYS,
    ),
    "out of view": source_views(*noise(2, HEIGHT, WIDTH), turns=[STILL] * 2, shifts=[[15.0, 0, 0], [0, -40.0, 0]]),
    "behind": source_views(
        *noise(2, HEIGHT, WIDTH), turns=[turned([0, 80, 0]), STILL], shifts=[[0, 0, 0], [1, 1, -2.5]]
    ),
}


@pytest.mark.parametrize("case", list(CASES))
def test_costs_are_those_of_the_twin(case: str) -> None:
    view = noise(HEIGHT, WIDTH)
    found = matching_costs(view, CASES[case], INVERSE_DEPTHS)
    assert (found.shape, found.dtype) == ((HEIGHT, WIDTH, len(INVERSE_DEPTHS)), np.uint8)
    np.testing.assert_array_equal(found, twin(view, CASES[case], INVERSE_DEPTHS))
    assert found.max() <= BITS


@pytest.mark.parametrize("shape", [(2, 2), (1, 9), (8, 3), (17, 5)])
def test_any_size_of_view(shape: tuple[int, int]) -> None:
    view, case = noise(*shape), CASES["three source views"]
    np.testing.assert_array_equal(matching_costs(view, case, INVERSE_DEPTHS), twin(view, case, INVERSE_DEPTHS))


def test_costs_vanish_where_the_view_is_found_again() -> None:
    """The source shows all of it four pixels farther right."""
    view = noise(HEIGHT, WIDTH)
    moved = np.roll(view, 4, axis=1)
    costs = matching_costs(view, source_views(moved, turns=[STILL], shifts=[[4, 0, 0]]), np.float32([0, 0.5, 1]))
    inside = costs[:, RADIUS : -4 - RADIUS]
    assert not inside[:, :, 2].any()
    assert inside[:, :, :2].mean() > BITS / 4


@pytest.mark.parametrize(("gain", "offset"), [(1, 60), (2, 0), (3, 17)])
def test_gain_and_offset_change_nothing(gain: int, offset: int) -> None:
    view, other = noise(2, HEIGHT, WIDTH, most=64)
    plain, bright = (
        source_views(image, turns=[STILL], shifts=[[4, 2, 0]])
        for image in (other, (gain * other + offset).astype(np.uint8))
    )
    whole_pixels = np.float32([0, 0.5, 1])
    expected = matching_costs(view, plain, whole_pixels)
    np.testing.assert_array_equal(matching_costs(view, bright, whole_pixels), expected)
    brighter = (gain * view + offset).astype(np.uint8)
    np.testing.assert_array_equal(matching_costs(brighter, plain, whole_pixels), expected)


def test_a_view_hidden_from_one_source_view_costs_nothing() -> None:
    view = noise(HEIGHT, WIDTH)
    hidden = source_views(view, noise(HEIGHT, WIDTH, seed=5), view, turns=[STILL] * 3, shifts=[[0, 0, 0]] * 3)
    assert not matching_costs(view, hidden, INVERSE_DEPTHS).any()
    alone = SourceViews(*(array[1:2] for array in hidden))
    assert matching_costs(view, alone, INVERSE_DEPTHS).mean() > BITS / 4


def test_what_no_reference_sees_costs_half() -> None:
    away = source_views(noise(HEIGHT, WIDTH), turns=[STILL], shifts=[[1000, 0, 0]])
    assert np.all(matching_costs(noise(HEIGHT, WIDTH), away, INVERSE_DEPTHS) == BITS // 2)


def test_a_reference_that_stands_on_the_ray() -> None:
    """There, 0 / 0 is where the pixel falls."""
    ahead = source_views(
        noise(HEIGHT, WIDTH), turns=[np.array([[1, 0, -11.5], [0, 1, -9.5], [0, 0, 1]])], shifts=[[0, 0, -1]]
    )
    view, depths = noise(HEIGHT, WIDTH), np.float32([0.5, 1.0])
    costs = matching_costs(view, ahead, depths)
    np.testing.assert_array_equal(costs, twin(view, ahead, depths))
    assert np.all(costs[:, :, 1] == BITS // 2)


def test_a_masked_reference_is_as_none() -> None:
    view, images = noise(HEIGHT, WIDTH), [noise(HEIGHT, WIDTH, seed=seed) for seed in (1, 2, 3)]
    among = source_views(*images, turns=[STILL] * 3, shifts=[[3, 0, 0], [0, 2, 0], [-2, 1, 0]])
    usable = np.ones(among.squares.shape, np.bool_)
    plain = matching_costs(view, among, INVERSE_DEPTHS)
    np.testing.assert_array_equal(matching_costs(view, among._replace(usable=usable), INVERSE_DEPTHS), plain)
    usable[2] = False
    without = matching_costs(view, SourceViews(*(array[:2] for array in among)), INVERSE_DEPTHS)
    np.testing.assert_array_equal(matching_costs(view, among._replace(usable=usable), INVERSE_DEPTHS), without)
    assert np.any(plain != without)
