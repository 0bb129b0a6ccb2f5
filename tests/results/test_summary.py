"""What `run.json` says of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from conftest import write_nerfstudio
from pocketgs.capture import Capture
from pocketgs.capture.open import list_capture
from pocketgs.results.checkpoint import CHECKPOINT
from pocketgs.results.run import run
from pocketgs.results.summary import _transients
from pocketgs.splat.colours import transforms_of
from pocketgs.training.options import TrainingOptions


def test_the_least_and_the_largest_gain_of_learned_colours(small_capture: Capture, tmp_path: Path) -> None:
    """Of all three channels; what one adds to another is no gain."""
    gains = np.random.default_rng(4).uniform(0.8, 1.2, (len(small_capture.train), 3))
    images = [np.clip(frame.image * gain, 0, 255) for frame, gain in zip(small_capture.train, gains, strict=True)]
    frames = [
        replace(frame, image=image.astype(np.uint8)) for frame, image in zip(small_capture.train, images, strict=True)
    ]
    write_nerfstudio(replace(small_capture, train=frames), tmp_path / "room")
    options = TrainingOptions(iterations=20, prior="none", colours="on", evaluate_every=0, engine="cpu")
    found = run(lambda: list_capture(tmp_path / "room"), tmp_path / "out", options).summary["colours"]
    with np.load(tmp_path / "out" / CHECKPOINT) as stored:
        learned = [[matrix[channel, channel] for channel in range(3)] for matrix in transforms_of(stored["colours"])]
    assert found["least_gain"] < 0.999 < 1.001 < found["largest_gain"]
    assert [found["least_gain"], found["largest_gain"]] == pytest.approx([np.min(learned), np.max(learned)])


def test_no_share_of_photographs_that_are_all_left_out_whole() -> None:
    cells = (np.ones((2, 3), np.bool_),) * 2
    result: Any = SimpleNamespace(checkpoint=SimpleNamespace(transients=cells), left_out=("a.png", "b.png"))
    assert _transients(result) == {"photographs": 0, "share": 0.0, "left_out": ["a.png", "b.png"]}
