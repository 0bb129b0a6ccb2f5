"""Depth maps compared on the GPU: votes against the Numba kernel, confidences against NumPy."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.prior.cloud.fuse import views_of
from pocketgs.prior.depth.confidence import FILLER_CONFIDENCE, confidence_map
from pocketgs.prior.depth.consistency import Agreement, SweptViews
from pocketgs.prior.depth.cpu.consistency import compare_depths
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.sweep import DepthMap
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo
from prior.random_depth_maps import random_views, with_copy

pytestmark = pytest.mark.usefixtures("adapter")

MOST_UNLIKE = 0.003
"""Share of pixels at which rounding may change a vote: where a point falls on a pixel's border."""

LEAST = 0.4
"""Confidence outside holes."""


@cache
def stereo() -> WebGpuStereo:
    return WebGpuStereo()


@cache
def room() -> SweptViews:
    """Depth maps of the demo's room, exact but for a noise of 1 %."""
    frames = true_capture(80, 60, frames=7, points=10).train
    rng = np.random.default_rng(0)
    depths = np.array([frame.depth for frame in frames]) * rng.normal(1.0, 0.01, (len(frames), 60, 80))
    depths[rng.random(depths.shape) < 0.1] = 0.0
    return views_of(frames, [DepthMap(depth, np.ones_like(depth), 0.004) for depth in depths.astype(np.float32)])


def moved(views: SweptViews, offset: list[float]) -> SweptViews:
    """The same in a world whose origin is elsewhere."""
    return views._replace(translations=views.translations - views.rotations @ np.array(offset))


def narrow() -> SweptViews:
    """Narrower than half the square in which confident pixels are counted."""
    views = random_views(1)
    return views._replace(sizes=np.array([[9, 3], [2, 8], [7, 1]]))


CASES = {
    "random": lambda: random_views(0),
    "random, again": lambda: random_views(3),
    "room": room,
    "a copy": lambda: with_copy(random_views(0), 0.003),
    "nearly a copy": lambda: with_copy(random_views(6), 0.0138),
    "far from the origin": lambda: moved(room(), [4e3, -7e3, 2e3]),
    "narrow": narrow,
}


def margins_of(views: SweptViews) -> list[np.ndarray]:
    """At random: some clear, some not."""
    rng = np.random.default_rng(5)
    return [rng.choice(np.float32([0.0, 0.02, 0.07, 0.5]), size, p=[0.2, 0.2, 0.3, 0.3]) for size in views.sizes]


def votes(view: int, views: SweptViews) -> Agreement:
    """Votes that the last comparison left on the GPU."""
    shape = tuple(views.sizes[view])
    words = stereo().comparing.read("votes", np.uint32, shape[0] * shape[1]).reshape(shape)
    footprints = stereo().comparing.read("footprints", np.float32, shape[0] * shape[1]).reshape(shape)
    return Agreement((words & 0xFFFF).astype(np.uint8), (words >> 16).astype(np.uint8), footprints)


@pytest.mark.parametrize("name", list(CASES))
@pytest.mark.parametrize("tolerance", [0.005, 0.05])
def test_votes_are_the_cpus(name: str, tolerance: float) -> None:
    views, some = CASES[name](), 0
    for view, _ in enumerate(stereo().compare(views, margins_of(views), tolerance, LEAST)):
        found, expected = votes(view, views), Agreement(*compare_depths(views, view, tolerance))
        same = (found.agreeing == expected.agreeing) & (found.contradicting == expected.contradicting)
        assert np.mean(~same) < MOST_UNLIKE
        np.testing.assert_allclose(found.footprints[same], expected.footprints[same], rtol=1e-5)
        some += int(expected.agreeing.sum()) * int(expected.contradicting.sum())
    assert some > 0 or name == "narrow"


@pytest.mark.parametrize("name", list(CASES))
def test_confidences_are_those_of_the_votes(name: str) -> None:
    """To rounding, and 0 at the same pixels; some of them are filled."""
    views = CASES[name]()
    margins = margins_of(views)
    filled = 0
    for view, found in enumerate(stereo().compare(views, margins, 0.05, LEAST)):
        height, width = views.sizes[view]
        expected = confidence_map(votes(view, views), views.depths[view, :height, :width], margins[view], LEAST)
        np.testing.assert_array_equal(found.confidences > 0, expected > 0)
        np.testing.assert_allclose(found.confidences, expected, rtol=1e-6)
        filled += int((expected == np.float32(FILLER_CONFIDENCE)).sum())
    assert filled > 0


def test_a_comparison_is_the_cpus() -> None:
    """Holes may differ around a vote that differs."""
    views, margins = room(), margins_of(room())
    given = (views, margins, 0.005, LEAST)
    for found, expected in zip(stereo().compare(*given), CpuStereo().compare(*given), strict=True):
        same = np.isclose(found.confidences, expected.confidences, rtol=1e-6)
        assert np.mean(~same) < 2 * MOST_UNLIKE
        np.testing.assert_allclose(found.footprints[same], expected.footprints[same], rtol=1e-5)


def test_more_depth_maps_than_the_device_holds_are_refused() -> None:
    small = WebGpuStereo()
    small._largest = 1000
    with pytest.raises(PocketGSError, match="the GPU's buffer 'maps' would take"):
        next(small.compare(room(), margins_of(room()), 0.005, LEAST))
