"""The CPU engine leaves Gaussians outside the view unchanged, like the reference."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.reference.scene import Scene
from splat.seen_only import (
    SETTINGS,
    assert_steps_agree_with_the_reference,
    assert_what_is_not_seen_drifts_on_otherwise,
    assert_what_is_not_seen_stays,
    two_groups,
)
from splat.training_step import reference_step

MakeGaussians = Callable[..., Gaussians]


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_not_seen_stays(make_gaussians: MakeGaussians, threads: int) -> None:
    assert_what_is_not_seen_stays(CpuEngine(threads), make_gaussians)


def test_what_is_not_seen_drifts_on_otherwise(make_gaussians: MakeGaussians) -> None:
    assert_what_is_not_seen_drifts_on_otherwise(CpuEngine(1), make_gaussians)


def test_steps_agree_with_the_reference(make_gaussians: MakeGaussians) -> None:
    assert_steps_agree_with_the_reference(CpuEngine(2), make_gaussians, tolerance=5e-3)


def test_the_reference_leaves_alone_what_is_not_seen(make_gaussians: MakeGaussians) -> None:
    gaussians, aside, frames = two_groups(make_gaussians)
    scene, before = Scene.of(gaussians), Scene.of(gaussians)
    _, _, moments = reference_step(scene, frames[0], SETTINGS)
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        moved = np.any((getattr(scene, name) != getattr(before, name)).reshape(len(aside), -1), axis=1)
        np.testing.assert_array_equal(moved, ~aside)
    first = moments.first.means.copy()
    assert not first[aside].any()
    reference_step(scene, frames[1], SETTINGS, moments)
    np.testing.assert_array_equal(moments.first.means[~aside], first[~aside])
    assert moments.first.means[aside].any(axis=1).all()
