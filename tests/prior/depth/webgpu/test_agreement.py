"""Depth maps compared on the GPU: against the Numba kernel."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.prior.cloud.fuse import views_of
from pocketgs.prior.depth.consistency import Views
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.sweep import DepthMap
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo
from prior.random_depth_maps import random_views

pytestmark = pytest.mark.usefixtures("adapter")

MOST_UNLIKE = 0.003
"""Share of pixels at which rounding may change a vote: where a point falls on a pixel's border."""


@cache
def stereo() -> WebGpuStereo:
    return WebGpuStereo()


def room() -> Views:
    """Depth maps of the demo's room, exact but for a noise of 1 %."""
    frames = true_capture(80, 60, frames=7, points=10).train
    rng = np.random.default_rng(0)
    depths = np.array([frame.depth for frame in frames]) * rng.normal(1.0, 0.01, (len(frames), 60, 80))
    depths[rng.random(depths.shape) < 0.1] = 0.0
    return views_of(frames, [DepthMap(depth, np.ones_like(depth), 0.004) for depth in depths.astype(np.float32)])


def moved(views: Views, offset: list[float]) -> Views:
    """The same in a world whose origin is elsewhere."""
    return views._replace(translations=views.translations - views.rotations @ np.array(offset))


CASES = {
    "random": random_views(0),
    "random, again": random_views(3),
    "room": room(),
    "far from the origin": moved(room(), [4e3, -7e3, 2e3]),
}


@pytest.mark.parametrize("name", list(CASES))
@pytest.mark.parametrize("tolerance", [0.005, 0.05])
def test_votes_are_the_cpus(name: str, tolerance: float) -> None:
    views, some = CASES[name], 0
    for found, expected in zip(stereo().compare(views, tolerance), CpuStereo().compare(views, tolerance), strict=True):
        assert found.agreeing.dtype == found.contradicting.dtype == np.uint8
        same = (found.agreeing == expected.agreeing) & (found.contradicting == expected.contradicting)
        assert np.mean(~same) < MOST_UNLIKE
        np.testing.assert_allclose(found.footprints[same], expected.footprints[same], rtol=1e-5)
        some += int(expected.agreeing.sum()) * int(expected.contradicting.sum())
    assert some > 0


def test_more_depth_maps_than_the_device_holds_are_refused() -> None:
    small = WebGpuStereo()
    small._largest = 1000
    with pytest.raises(PocketGSError, match="the GPU's buffer 'maps' would take"):
        next(small.compare(CASES["room"], 0.005))
