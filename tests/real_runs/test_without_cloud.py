"""Whole runs on parts of captures without a cloud."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from real_runs.commands import check

pytestmark = pytest.mark.slow


def part_of(capture: Path, folder: Path, frames: slice) -> Path:
    """Some frames of a capture in Blender's layout or nerfstudio's: finding poses takes most of the time."""
    shutil.copytree(capture, folder)
    for path in folder.glob("*.json"):
        document = json.loads(path.read_text())
        document["frames"] = document["frames"][frames]
        path.write_text(json.dumps(document))
    return folder


def test_lego(trained: Callable[..., dict[str, Any]], data_folder: Path, tmp_path: Path) -> None:
    """Every fifth frame of a capture with alpha, on white: far apart, but none is left out for its pose."""
    few = part_of(data_folder / "lego", tmp_path / "few" / "lego", slice(None, None, 5))
    options = ["--downscale", 5, "--effort", "quick", "--iterations", 150, "--max-gaussians", 20_000]
    record = trained(few, *options)
    assert record["protocol"] == "downscaled to 160x160, on white, data set's own split"
    assert record["capture"]["held_out_views"] == 5
    check(record, psnr=27.95, ssim=0.932)


def test_fox(trained: Callable[..., dict[str, Any]], data_folder: Path, tmp_path: Path) -> None:
    """The first twenty frames of a hand-held capture without a cloud, of which some are missing."""
    few = part_of(data_folder / "fox", tmp_path / "few" / "fox", slice(20))
    options = ["--downscale", 8, "--effort", "quick", "--iterations", 120, "--max-gaussians", 20_000]
    record = trained(few, *options)
    assert record["protocol"] == "undistorted, cropped, downscaled to 133x237, held out every 8th by name"
    assert any("4 of 20 listed frames have no image file" in each for each in record["capture"]["warnings"])
    check(record, psnr=31.8, ssim=0.952)
