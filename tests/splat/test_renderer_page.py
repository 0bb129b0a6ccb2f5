"""The examples in docs/renderer.md run: the loss of the first falls, and the second measures what a run states."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pocketgs
from documentation import ROOT
from pocketgs import Capture, Gaussians, PocketGSError, photometric_loss
from pocketgs.results.held_out import evaluate_held_out
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.reference.loss import photometric_loss as reference_loss
from pocketgs.splat.settings import LossSettings


def examples() -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "renderer.md").read_text(encoding="utf-8"), re.DOTALL)


def test_the_example_learns(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(examples()[0], {})
    losses = [float(number) for number in re.findall(r"mean squared error ([\d.]+)", capsys.readouterr().out)]
    assert len(losses) == 4
    assert losses[-1] < 0.3 * losses[0]
    assert len(Gaussians.load(tmp_path / "picture.ply")) == 600


def test_the_example_measures_as_a_run_does(small_capture: Capture, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where renderings are brighter than white, and on the capture's background."""
    assert small_capture.points is not None
    points = small_capture.points
    capture = replace(small_capture, background=(0.2, 0.4, 0.6))
    sh = (5.0 * points.colours[:, None] - 1.0).astype(np.float32)
    size, turns = np.full((len(points), 3), -3.0), np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))
    scene = Gaussians(points.positions, size, turns, np.full(len(points), 2.0), sh)
    exec(examples()[1], {"pocketgs": pocketgs, "capture": capture, "scene": scene})
    engine = create_engine()
    engine.upload(scene)
    expected = evaluate_held_out(engine, capture)
    assert expected is not None
    found = ast.literal_eval(capsys.readouterr().out)
    assert list(found) == list(expected.means)
    assert [found[name] for name in ("psnr", "cc_psnr", "ssim")] == pytest.approx(
        [expected.psnr, expected.cc_psnr, expected.ssim], rel=1e-4
    )
    frame = capture.held_out[0]
    assert engine.render(frame.camera, capture.background).image.max() > 1.0


def test_the_loss_of_training_is_a_piece_of_its_own() -> None:
    rng = np.random.default_rng(1)
    rgb, photo = rng.uniform(size=(20, 30, 3)).astype(np.float32), rng.integers(0, 256, (20, 30, 3)).astype(np.uint8)
    mask = rng.uniform(size=(20, 30)) > 0.3
    for one in (None, mask):
        loss, gradient = photometric_loss(rgb, photo, mask=one)
        expected, d_expected = reference_loss(rgb.astype(np.float64), photo / 255.0, LossSettings(), one)
        assert loss == pytest.approx(expected, rel=1e-5)
        np.testing.assert_allclose(gradient, d_expected, atol=1e-3 * np.abs(d_expected).max())
    with pytest.raises(PocketGSError, match=r"expected \(H, W, 3\) and uint8"):
        photometric_loss(rgb, photo / 255.0)
