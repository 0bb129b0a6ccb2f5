"""Exposure: gains found in photographs, undone, and left alone where a scene can take them in."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.exposure import BRIGHTEST, compensated, exposure_gains, needs_compensation
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.tracks import view_distances
from pocketgs.prior.poses.structure import Structure
from pocketgs.prior.scale import Scale, estimate_scale


def exposed(frames: Sequence[Frame], gains: np.ndarray) -> list[Frame]:
    """The photographs as a camera takes them whose exposure and white balance differ by (F, 3) gains."""
    return [
        replace(frame, image=np.rint(np.clip(frame.image * gain, 0, 255)).astype(np.uint8))
        for frame, gain in zip(frames, gains, strict=True)
    ]


def random_gains(count: int, seed: int = 0) -> np.ndarray:
    """(F, 3) gains of up to 20 %, with a geometric mean of 1."""
    logarithms = np.random.default_rng(seed).uniform(-0.2, 0.2, (count, 3))
    return np.exp(logarithms - logarithms.mean(axis=0))


@pytest.fixture
def scale(clean_walk: Capture) -> Scale:
    return estimate_scale(clean_walk)


def test_gains_are_found(clean_walk: Capture, clean_structure: Structure, scale: Scale) -> None:
    gains = random_gains(len(clean_walk.train))
    found = exposure_gains(exposed(clean_walk.train, gains), clean_structure, scale)
    assert np.abs(found / gains - 1).mean() < 0.01
    np.testing.assert_allclose(found, gains, rtol=0.02)
    np.testing.assert_allclose(np.log(found).mean(axis=0), 0.0, atol=1e-9)


def test_equal_exposures_give_ones(clean_walk: Capture, clean_structure: Structure, scale: Scale) -> None:
    gains = exposure_gains(clean_walk.train, clean_structure, scale)
    np.testing.assert_allclose(gains, 1.0, atol=0.01)
    assert not needs_compensation(clean_walk.train, gains, scale)


def test_compensation_undoes_exposure(clean_walk: Capture, clean_structure: Structure, scale: Scale) -> None:
    photographs = exposed(clean_walk.train, random_gains(len(clean_walk.train)))
    gains = exposure_gains(photographs, clean_structure, scale)
    for before, photograph, after in zip(clean_walk.train, photographs, compensated(photographs, gains), strict=True):
        assert after.image.dtype == np.uint8
        assert replace(after, image=photograph.image) == photograph
        unclipped = (photograph.image < 255) & (photograph.image.min(axis=2, keepdims=True) <= BRIGHTEST)
        difference = np.abs(after.image.astype(int) - before.image)[unclipped]
        assert difference.mean() < 1.0
        assert difference.max() <= 4


def test_gains_of_one_change_nothing(clean_walk: Capture) -> None:
    for before, after in zip(clean_walk.train, compensated(clean_walk.train, np.ones((10, 3))), strict=True):
        np.testing.assert_array_equal(after.image, before.image)


@pytest.mark.parametrize("gain", [0.01, 100.0])
def test_compensated_levels_stay_in_range(clean_walk: Capture, gain: float) -> None:
    (frame,) = compensated(clean_walk.train[:1], np.full((1, 3), gain))
    expected, before = 0 if gain > 1 else 255, clean_walk.train[0].image
    changed = (before > 5) & (before.min(axis=2, keepdims=True) <= BRIGHTEST)
    assert np.all(frame.image[changed] <= expected + 3)
    assert np.all(frame.image[changed] >= expected - 3)


def test_white_stays_white(clean_walk: Capture) -> None:
    """It may be cut off, or what an object was laid on. Just below, it changes less and less."""
    image = np.full((180, 240, 3), 200, np.uint8)
    image[0, :16] = np.arange(240, 256, dtype=np.uint8)[:, None]
    image[1, 0] = 255, 60, 60
    (after,) = compensated([replace(clean_walk.train[0], image=image)], np.full((1, 3), 1.4))
    np.testing.assert_array_equal(after.image[0, 15], 255)
    levels = after.image[0, :16, 0].astype(int)
    assert np.all(np.diff(levels) >= 0)
    np.testing.assert_array_equal(levels[:8], np.rint(np.arange(240, 248) / 1.4))
    np.testing.assert_array_equal(after.image[1, 0], np.rint(np.array([255, 60, 60]) / 1.4))
    assert np.all(after.image[2:] == 143)


@pytest.mark.parametrize("by", ["alpha", "mask"])
def test_what_is_masked_does_not_count(clean_walk: Capture, clean_structure: Structure, scale: Scale, by: str) -> None:
    left, edge = np.zeros((180, 240), bool), np.zeros((180, 240), bool)
    left[:, :150], edge[:, :156] = True, True  # the blur under which colours are compared reaches past the edge
    spoilt, dark = list(clean_walk.train), clean_walk.train[4].image.copy()
    dark[left] //= 3
    spoilt[4] = replace(spoilt[4], image=dark)
    seen = exposure_gains(spoilt, clean_structure, scale)
    assert seen[4].max() < 0.6
    alpha = np.where(edge, 0, 255).astype(np.uint8)
    spoilt[4] = replace(spoilt[4], alpha=alpha) if by == "alpha" else replace(spoilt[4], mask=~edge)
    gains = exposure_gains(spoilt, clean_structure, scale)
    np.testing.assert_allclose(gains, 1.0, atol=0.02)


def test_too_few_points_leave_gains_at_one(clean_walk: Capture, clean_structure: Structure, scale: Scale) -> None:
    photographs = exposed(clean_walk.train, random_gains(len(clean_walk.train)))
    seen = clean_structure.observations
    some = np.concatenate([np.flatnonzero(seen.frame == view)[:9] for view in range(len(clean_structure.cameras))])
    few = replace(clean_structure, observations=seen.select(np.sort(some)))
    np.testing.assert_array_equal(exposure_gains(photographs, few, scale), np.ones((10, 3)))


@pytest.mark.parametrize("level", [0, 255])
def test_a_photograph_that_shows_nothing_takes_the_gain_of_the_most_similar_view(
    clean_walk: Capture, clean_structure: Structure, scale: Scale, level: int
) -> None:
    photographs = exposed(clean_walk.train, random_gains(len(clean_walk.train)))
    whole = exposure_gains(photographs, clean_structure, scale)
    photographs[3] = replace(photographs[3], image=np.full_like(photographs[3].image, level))
    gains = exposure_gains(photographs, clean_structure, scale)
    cameras = [frame.camera for frame in photographs]
    (apart,) = view_distances(cameras[3:4], cameras, scale.distance)
    expected = whole.copy()
    expected[3] = whole[np.argsort(apart)[1]]
    np.testing.assert_allclose(gains, expected / np.exp(np.log(expected).mean(axis=0)), rtol=0.01)
    np.testing.assert_allclose(np.log(gains).mean(axis=0), 0.0, atol=1e-9)


def test_one_photograph_that_shows_something_leaves_gains_at_one(
    clean_walk: Capture, clean_structure: Structure, scale: Scale
) -> None:
    blank = [replace(frame, image=np.zeros_like(frame.image)) for frame in clean_walk.train[1:]]
    gains = exposure_gains([clean_walk.train[0], *blank], clean_structure, scale)
    np.testing.assert_array_equal(gains, np.ones((10, 3)))


def plain(centre: Sequence[float], colour: np.ndarray) -> Frame:
    """A photograph of 32 x 24 pixels of one colour, which looks along z from a place."""
    pose = np.eye(4)
    pose[:3, 3] = np.negative(centre)
    image = np.broadcast_to(colour.astype(np.uint8), (24, 32, 3)).copy()
    return Frame(f"{centre}.png", Camera(32, 24, 8.0, 8.0, 16.0, 12.0, pose), image)


def test_memory_is_for_points_that_photographs_see(clean_structure: Structure) -> None:
    # A walk along a wall of 15,000 points, 200 of them in a view, and 30 views of the whole wall.
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 301, 15_150), rng.uniform(-0.5, 0.5, 15_150), np.ones(15_150)])
    centres = [(float(x), 0.0, 0.0) for x in range(300)] + [(150.0, 0.0, -150.0 - y) for y in range(30)]
    colours = rng.integers(60, 180, (len(centres), 3))
    photographs = [plain(centre, colour) for centre, colour in zip(centres, colours, strict=True)]
    near = [np.abs(points[:, 0] - x) < 2 * (1 - z) for x, _, z in centres]
    point, frame = np.nonzero(np.transpose(near))
    seen = Observations(frame.astype(np.int32), point.astype(np.int32), np.zeros((len(point), 2)))
    cameras = [photograph.camera for photograph in photographs]
    structure = replace(clean_structure, cameras=cameras, points=points, observations=seen)
    tracemalloc.start()
    try:
        gains = exposure_gains(photographs, structure, Scale(1.0, 1.0))
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
    np.testing.assert_allclose(gains, colours / np.exp(np.log(colours).mean(axis=0)), rtol=0.01)


STEPS = np.linspace(-1.0, 1.0, 10)
JUMPS = np.array([1.0, -1.0] * 5)


def test_white_balance_that_jumps_needs_compensation(clean_walk: Capture, scale: Scale) -> None:
    warmer = 0.1 * np.outer(JUMPS, [1.0, 0.0, -1.0])
    assert needs_compensation(clean_walk.train, np.exp(warmer), scale)
    assert not needs_compensation(clean_walk.train, np.exp(0.05 * warmer), scale)


@pytest.mark.parametrize(
    ("logarithms", "needed"),
    [
        (0.0 * STEPS, False),
        (0.2 * STEPS, False),
        (0.2 * np.sin(2 * STEPS), False),
        (0.001 * JUMPS, False),
        (0.1 * JUMPS, True),
        (0.1 * JUMPS + 0.05 * STEPS, True),
    ],
    ids=["constant", "rising", "swinging", "hardly jumping", "jumping", "jumping and rising"],
)
def test_only_jumps_need_compensation(clean_walk: Capture, scale: Scale, logarithms: np.ndarray, needed: bool) -> None:
    gains = np.exp(np.repeat(logarithms[:, None], 3, axis=1))
    assert needs_compensation(clean_walk.train, gains, scale) == needed
    # It is the views that tell what is near, not the order of frames.
    order = np.random.default_rng(0).permutation(10)
    assert needs_compensation([clean_walk.train[index] for index in order], gains[order], scale) == needed


def test_one_photograph_needs_no_compensation(clean_walk: Capture, scale: Scale) -> None:
    assert not needs_compensation(clean_walk.train[:1], np.ones((1, 3)), scale)


def test_two_photographs_that_differ_need_compensation(clean_walk: Capture, scale: Scale) -> None:
    assert needs_compensation(clean_walk.train[:2], np.exp([[0.1] * 3, [-0.1] * 3]), scale)
