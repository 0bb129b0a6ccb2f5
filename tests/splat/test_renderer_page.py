"""The example in docs/renderer.md runs, and its loss falls."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from documentation import ROOT
from pocketgs import Gaussians, PocketGSError, photometric_loss
from pocketgs.splat.reference.loss import photometric_loss as reference_loss
from pocketgs.splat.settings import LossSettings


def test_the_example_learns(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "renderer.md").read_text(encoding="utf-8")
    found = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert found is not None
    monkeypatch.chdir(tmp_path)
    exec(found[1], {})
    losses = [float(number) for number in re.findall(r"mean squared error ([\d.]+)", capsys.readouterr().out)]
    assert len(losses) == 4
    assert losses[-1] < 0.3 * losses[0]
    assert len(Gaussians.load(tmp_path / "picture.ply")) == 600


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
