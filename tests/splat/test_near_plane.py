"""The near plane: relative to the scene, and robust to a few distant or non-finite Gaussians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.constants import NEAR
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.near_plane import near_plane


@pytest.mark.parametrize("exponent", [-20, -1, 0, 3, 20])
def test_it_grows_with_the_scene(exponent: int) -> None:
    means = np.random.default_rng(0).normal(size=(9000, 3)).astype(np.float32)
    assert near_plane(means * np.float32(2.0**exponent)) == 2.0**exponent * near_plane(means)
    assert NEAR / 2 <= near_plane(means) <= 2 * NEAR


def test_what_is_far_or_broken_does_not_move_it() -> None:
    means = np.random.default_rng(1).normal(size=(1000, 3))
    strange = means.copy()
    strange[::5] *= 1e4
    strange[1::5] = np.nan
    assert near_plane(strange) <= 2 * near_plane(means)


@pytest.mark.parametrize("means", [np.zeros((0, 3)), np.ones((7, 3)), np.full((3, 3), np.nan)])
def test_a_scene_without_extent_counts_as_one_unit_wide(means: np.ndarray) -> None:
    assert near_plane(means) == NEAR


def test_a_resumed_run_keeps_the_near_plane_that_it_began_with() -> None:
    """Its scene may have grown by a factor of two since; the uninterrupted run would not notice."""
    means = np.random.default_rng(2).normal(size=(200, 3))
    scene = Gaussians(
        means, np.full((200, 3), -4.0), np.tile([1.0, 0, 0, 0], (200, 1)), np.ones(200), np.ones((200, 1, 3))
    )
    engine = CpuEngine()
    engine.upload(scene)
    state = engine.optimiser_state()
    assert state.near == near_plane(scene.means)
    grown = replace(scene, means=8.0 * scene.means)
    grown.means[0] = (0.0, 0.0, 3.0 * state.near)
    assert near_plane(grown.means) > 4.0 * state.near
    engine.upload(grown, state)
    assert engine.optimiser_state().near == state.near
    camera = Camera(32, 32, 32.0, 32.0, 16.0, 16.0, np.eye(4))
    seen = engine.render(camera).alpha[16, 16]
    engine.upload(grown)
    assert engine.render(camera).alpha[16, 16] < seen
