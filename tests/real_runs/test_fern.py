"""Whole runs on fern: quality that must not fall, within bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.slow


def test_fern_with_standard_effort(trained: Callable[..., dict[str, Any]]) -> None:
    """The default: more work than the other runs here."""
    record = trained("fern", "--images", "images_8", "--downscale", 4, "--effort", "standard")
    print(f"{record['psnr']:.2f} dB, {record['keyframes']} keyframes, {record['coverage']:.4f} covered")
    assert record["options"]["effort"] == "standard"
    assert record["protocol"] == "undistorted, cropped, downscaled to 124x93, held out every 8th by name"
    assert record["psnr"] >= 32.15
    assert record["coverage"] >= 0.99
    assert 50_000 <= record["options"]["max_gaussians"] < 60_000
    assert record["gaussians"] <= record["options"]["max_gaussians"]
    assert record["peak_rss_mb"] < 1000


def test_fern_with_the_reference_recipe(trained: Callable[..., dict[str, Any]]) -> None:
    """From the capture's own cloud, as in the comparison that the recipe is for."""
    options = ["--recipe", "reference", "--prior", "none", "--seeds", "balls", "--iterations", 300]
    record = trained("fern", "--images", "images_8", "--downscale", 4, *options)
    assert record["psnr"] == pytest.approx(24.9, abs=0.3)
    assert record["peak_rss_mb"] < 450


@pytest.mark.usefixtures("adapter")
def test_fern_on_the_gpu_engine(trained: Callable[..., dict[str, Any]]) -> None:
    """A short run from the same points follows the CPU engine's: on any adapter, software ones included."""
    options = ["--downscale", 4, "--prior", "none", "--iterations", 12, "--evaluate-every", 4]
    cpu, gpu = (trained("fern", "--images", "images_8", *options, "--engine", name) for name in ("cpu", "webgpu"))
    assert gpu["engine"] == "webgpu"
    for one, other in zip(cpu["progress"], gpu["progress"], strict=True):
        assert other["loss"] == pytest.approx(one["loss"], rel=0.01)
        assert other["held_out_psnr"] == pytest.approx(one["held_out_psnr"], abs=0.1)
    assert gpu["psnr"] == pytest.approx(cpu["psnr"], abs=0.05)
