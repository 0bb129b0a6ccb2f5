"""Results do not depend on the unit and origin of a capture's coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs import Capture, TrainingOptions
from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.metrics.evaluation import psnr
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.rendering import render_frame
from pocketgs.training.preparation import prepare
from pocketgs.training.train import train

OPTIONS = TrainingOptions(engine="cpu", iterations=30, max_gaussians=2000, evaluate_every=0)


def scaled(capture: Capture, factor: float) -> Capture:
    """The capture in another unit of length, without the claim to be metric."""

    def of(frames: list[Frame]) -> list[Frame]:
        result = []
        for frame in frames:
            pose = frame.camera.world_to_camera.copy()
            pose[:3, 3] *= factor
            result.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
        return result

    assert capture.points is not None
    points = replace(capture.points, positions=factor * capture.points.positions)
    return replace(capture, train=of(capture.train), held_out=of(capture.held_out), points=points, metric=False)


def quality(capture: Capture) -> float:
    """Mean PSNR over all views after a short run."""
    prepared = prepare(capture, OPTIONS)
    engine = create_engine(OPTIONS.engine_options)
    engine.upload(train(prepared, OPTIONS).scene)
    frames = prepared.frames
    return float(np.mean([psnr(render_frame(engine, f, capture.background), f.image / 255.0) for f in frames]))


@pytest.fixture(scope="module")
def capture() -> Capture:
    return true_capture(width=128, height=96, frames=12, points=500)


@pytest.fixture(scope="module")
def expected(capture: Capture) -> float:
    return quality(scaled(capture, 1.0))


# Powers of two, in which rounding is the same: of the noise that other factors make, a short run shows too much.
@pytest.mark.parametrize("factor", [2.0**-20, 2.0**20])
def test_the_unit_changes_nothing(capture: Capture, expected: float, factor: float) -> None:
    assert quality(scaled(capture, factor)) == pytest.approx(expected, abs=0.1)
