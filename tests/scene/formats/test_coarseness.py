"""Files whose centres share a grid: one far Gaussian makes it coarse for all, which is a warning."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pocketgs.scene.formats import read_scene, write_scene
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


def write_doubles(path: Path, offset: float, kind: str = "f8") -> None:
    """Write a `.ply` of Gaussians of size 0.01, `offset` away from the origin, with centres of another type."""
    with_floater(1.0).save(path)
    data = PlyData.read(str(path), mmap=False)["vertex"].data
    table = data.astype([(name, kind if name in "xyz" else "f4") for name in data.dtype.names])
    for name in "xyz":
        table[name] += offset
    PlyData([PlyElement.describe(table, "vertex")], byte_order="<").write(str(path))


def test_doubles_that_are_rounded_are_a_warning(tmp_path: Path) -> None:
    """Geographic coordinates in metres have seven digits before the point, and float32 holds as many in all."""
    write_doubles(tmp_path / "far.ply", 4.5e6)
    told = r"far\.ply: centres are rounded to steps of 0\.5, .* smaller than 0\.01: .* reach 4\.5e\+06\. Move the scene"
    with pytest.warns(SceneWarning, match=told):
        read_scene(tmp_path / "far.ply")


@pytest.mark.parametrize(("offset", "kind"), [(1e4, "f8"), (4.5e6, "f4"), (0.0, "f8")])
def test_no_warning_where_reading_rounds_little(tmp_path: Path, offset: float, kind: str) -> None:
    write_doubles(tmp_path / "scene.ply", offset, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_scene(tmp_path / "scene.ply")


@pytest.mark.parametrize("suffix", [".pgs", ".spz"])
def test_needles_are_as_small_as_they_are_wide(tmp_path: Path, suffix: str) -> None:
    """Trained Gaussians are often several times as long as wide: across, a step of their length shows."""
    scene = with_floater(4e4)
    scene.log_scales[:, 0] = np.log(0.1)
    scene.log_scales[:, 2] = np.log(0.001)
    with pytest.warns(SceneWarning, match="half of the Gaussians are smaller than 0.01:"):
        write_scene(tmp_path / f"far{suffix}", scene)
