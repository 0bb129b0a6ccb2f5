"""Scenes in units of length that do not suit a `.spz`, whose sizes lie within e^-10 to e^5.94."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from pocketgs.scene.edits import scaled
from pocketgs.scene.formats import write_scene
from pocketgs.scene.formats.spz_range import MOST, suitable_factor
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import SceneWarning
from scene.formats.scenes import random_scene


def in_metres() -> Gaussians:
    """Gaussians of about 0.1 m."""
    scene = random_scene(2000, 1)
    scene.log_scales[:] = np.random.default_rng(0).normal(-2.5, 1.0, (2000, 3))
    return scene


@pytest.mark.parametrize(("units", "remedy"), [(1e3, "0.001"), (1e4, "0.0001"), (1e-4, "10000")])
def test_other_units_are_a_warning_that_names_the_factor(tmp_path: Path, units: float, remedy: str) -> None:
    scene = scaled(in_metres(), units)
    with pytest.warns(SceneWarning, match=rf"out\.spz: .* --scale {re.escape(remedy)}, or write") as told:
        write_scene(tmp_path / "out.spz", scene)
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_scene(tmp_path / "out.spz", scaled(scene, float(remedy)))


@pytest.mark.parametrize("units", [0.1, 1.0, 10.0])
def test_no_warning_where_sizes_fit(tmp_path: Path, units: float) -> None:
    """Discs may be thinner than the range."""
    scene = scaled(in_metres(), units)
    scene.log_scales[:, 2] = -20.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_scene(tmp_path / "out.spz", scene)


def test_few_large_gaussians_matter(tmp_path: Path) -> None:
    """They may be the sky. No factor helps where the others are of medium size."""
    scene = in_metres()
    scene.log_scales[:2] = MOST + 1.0
    assert suitable_factor(scene) == 1.0
    with pytest.warns(SceneWarning, match=r"0\.10% larger than a \.spz holds, .* to 379 .* that; write a \.ply"):
        write_scene(tmp_path / "out.spz", scene)
