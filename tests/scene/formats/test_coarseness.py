"""Files whose centres share a grid: one far Gaussian makes it coarse for all, which is a warning."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from pocketgs.scene.formats import write_scene
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import SceneWarning
from scene.formats.scenes import random_scene


def with_floater(distance: float) -> Gaussians:
    """Gaussians of size 0.01 within 3 of the origin, but for one."""
    scene = random_scene(200, 1)
    scene.log_scales[:] = np.log(0.01)
    scene.means[7] = distance, 0, 0
    return scene


@pytest.mark.parametrize("suffix", [".pgs", ".spz"])
def test_one_far_gaussian_is_a_warning(tmp_path: Path, suffix: str) -> None:
    with pytest.warns(SceneWarning, match=rf"far{suffix}: .* half of the Gaussians .* 1e\+05.*--crop-box"):
        write_scene(tmp_path / f"far{suffix}", with_floater(1e5))


@pytest.mark.parametrize("suffix", [".pgs", ".spz", ".sog", ".ply", ".glb", ".compressed.ply"])
def test_no_warning_where_steps_are_fine_enough(tmp_path: Path, suffix: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_scene(tmp_path / f"near{suffix}", with_floater(1e3))


def test_no_warning_where_nothing_is_rounded(tmp_path: Path) -> None:
    """Few whole numbers lie on a grid of any size."""
    scene = with_floater(2.0**20)
    scene.means[:] = np.rint(scene.means)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_scene(tmp_path / "whole.pgs", scene)


@pytest.mark.parametrize("suffix", [".pgs", ".spz"])
def test_needles_are_as_small_as_they_are_wide(tmp_path: Path, suffix: str) -> None:
    """Trained Gaussians are often several times as long as wide: across, a step of their length shows."""
    scene = with_floater(4e4)
    scene.log_scales[:, 0] = np.log(0.1)
    scene.log_scales[:, 2] = np.log(0.001)
    with pytest.warns(SceneWarning, match="half of the Gaussians are smaller than 0.01:"):
        write_scene(tmp_path / f"far{suffix}", scene)
