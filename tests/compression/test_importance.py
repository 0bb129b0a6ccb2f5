"""Importance of Gaussians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.importance import Importance, importance
from pocketgs.compression.pruning import Pruner
from pocketgs.compression.rounding import ORDER
from pocketgs.compression.views import Views, cameras_around
from pocketgs.errors import PocketGSError
from pocketgs.scene.formats.pgs_coding import DEFAULT
from pocketgs.scene.formats.pgs_rounding import GROUPS, rounded
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rasterizer import Rasterizer


@pytest.mark.parametrize("measure", ["contribution", "distinct"])
def test_what_nobody_sees_goes_first(scene: Gaussians, views: Views, engine: Engine, measure: Importance) -> None:
    hidden = np.arange(0, len(scene), 5)
    means = scene.means.copy()
    means[hidden] += 1000.0
    moved = replace(scene, means=means)
    cameras = [frame.camera for frame in views.train]
    assert not importance(moved, cameras, Rasterizer(), measure)[hidden].any()
    pruner = Pruner(FineTuner(engine, views.train, views.background, scene, 0), cameras, measure, Rasterizer())
    kept = pruner.down_to(moved, len(scene) - len(hidden))
    assert np.abs(kept.means).max() < 500.0


def test_frozen_groups_stay(scene: Gaussians, views: Views, engine: Engine) -> None:
    """Bit for bit, including quaternions, so that rounded values stay rounded."""
    assert set(ORDER) == set(GROUPS)
    start = rounded(scene, DEFAULT, ["log_scales", "quaternions"])
    tuner = FineTuner(engine, views.train, views.background, scene, 0)
    found = tuner.tune(start, 5, frozen=["log_scales", "quaternions", "sh_rest"])
    np.testing.assert_array_equal(found.log_scales, start.log_scales)
    np.testing.assert_array_equal(found.sh[:, 1:], start.sh[:, 1:])
    np.testing.assert_array_equal(rounded(found, DEFAULT, ["quaternions"]).quaternions, start.quaternions)
    for name in ("means", "opacity_logits"):
        assert (getattr(found, name) != getattr(start, name)).any()


def test_cameras_around_a_scene_see_it(scene: Gaussians) -> None:
    cameras = list(cameras_around(scene).values())
    seen = importance(scene, cameras, Rasterizer()) > 0
    assert seen.mean() > 0.95
    with pytest.raises(PocketGSError, match="a single point"):
        cameras_around(scene.select(np.zeros(3, int)))
