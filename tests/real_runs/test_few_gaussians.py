"""A run with few Gaussians on photographs as they were taken, and its scene in a small file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from real_runs.commands import check, succeeds

pytestmark = pytest.mark.slow

AS_PHOTOGRAPHED = ("--images", "images_8", "--lens", "ignore", "--downscale", 4)


@pytest.fixture(scope="module")
def few_gaussians(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a run with the lens' distortion, which no pinhole camera can reproduce."""
    output = tmp_path_factory.mktemp("few") / "fern"
    options = (*AS_PHOTOGRAPHED, "--effort", "quick", "--iterations", 200, "--max-gaussians", 6000)
    succeeds("train", data_folder / "fern", "--output", output, *options)
    return output


def test_fern_as_photographed(few_gaussians: Path) -> None:
    check(json.loads((few_gaussians / "run.json").read_text()), psnr=29.28, ssim=0.9405)


def test_fern_compressed(few_gaussians: Path, data_folder: Path, tmp_path: Path) -> None:
    """A twenty-fifth of the size, for at most 0.3 dB on photographs that took no part."""
    path, figures = tmp_path / "fern.pgs", tmp_path / "figures.json"
    outputs = ("--output", path, "--json", figures)
    succeeds("compress", few_gaussians, data_folder / "fern", *AS_PHOTOGRAPHED, *outputs)
    original, spz, *pgs = json.loads(figures.read_text())["figures"]
    [written] = [row for row in pgs if row["name"] == ".pgs, written"]
    print(original, spz, written)
    assert written["psnr"] >= original["psnr"] - 0.3
    assert 25 * written["megabytes"] <= original["megabytes"]
    assert 2 * written["megabytes"] <= spz["megabytes"]
