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
    """Every fourth frame of a capture with alpha, on white: far apart, but none is left out for its pose."""
    few = part_of(data_folder / "lego", tmp_path / "few" / "lego", slice(None, None, 4))
    record = trained(few, "--downscale", 4, "--effort", "quick", "--iterations", 300)
    assert record["protocol"] == "downscaled to 200x200, on white, data set's own split"
    assert record["capture"]["held_out_views"] == 7
    check(record, psnr=30.0, ssim=0.959)


def test_fox(trained: Callable[..., dict[str, Any]], data_folder: Path, tmp_path: Path) -> None:
    """The first half of a hand-held capture without a cloud, of which some frames are missing."""
    half = part_of(data_folder / "fox", tmp_path / "half" / "fox", slice(34))
    record = trained(half, "--downscale", 6, "--effort", "quick", "--iterations", 200)
    assert record["protocol"] == "undistorted, cropped, downscaled to 177x317, held out every 8th by name"
    assert "5 of 34 listed frames have no image file" in record["capture"]["warnings"][0]
    check(record, psnr=31.7, ssim=0.939)
