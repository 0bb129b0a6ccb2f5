"""The quality that decisions expect, and the views that they look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.compression.bound import QualityBound
from pocketgs.compression.compress import compress
from pocketgs.compression.judgement import WORTH, Judge, errors
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.views import Views, photographed, rendered
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import Engine, Rendering
from pocketgs.splat.rendering import BLACK


@pytest.fixture
def capture(small_capture: Capture) -> Capture:
    """The small capture with three of its eight views held out."""
    train = small_capture.train
    return replace(small_capture, train=train[:-2], held_out=[*small_capture.held_out, *train[-2:]])


@pytest.fixture
def views(capture: Capture) -> Views:
    """Its photographs; one judges."""
    return photographed(capture)


class WatchedEngine(CpuEngine):
    """An engine that keeps the cameras that it renders and trains on."""

    def __init__(self) -> None:
        super().__init__(None)
        self.seen: list[Camera] = []

    def set_views(self, frames: Sequence[Frame]) -> None:
        self.seen += [frame.camera for frame in frames]
        super().set_views(frames)

    def render(self, camera: Camera, background: tuple[float, float, float] = BLACK, depth: bool = False) -> Rendering:
        self.seen.append(camera)
        return super().render(camera, background, depth)


@pytest.mark.usefixtures("_few_steps")
def test_reported_views_take_no_part(scene: Gaussians, views: Views) -> None:
    engine = WatchedEngine()
    compress(scene, views, engine, seconds=0.5)
    assert {id(frame.camera) for frame in [*views.train, *views.judges]} == {id(camera) for camera in engine.seen}


def test_held_out_photographs_are_shared_out(capture: Capture) -> None:
    for number in range(len(capture.held_out) + 1):
        views = photographed(replace(capture, held_out=capture.held_out[:number]))
        assert len(views.judges) + len(views.reported) == number
        assert len(views.reported) - len(views.judges) in (0, 1)


def test_the_loss_is_that_on_judges_and_training_views(scene: Gaussians, views: Views, engine: Engine) -> None:
    judge = Judge.of(scene, engine, views)
    assert judge.psnr(scene) == pytest.approx(judge.original_psnr, abs=1e-6)
    worse = replace(scene, opacity_logits=scene.opacity_logits - 1.0)
    judged = 10.0 * np.log10(errors(engine, worse, views, views.judges) / judge.unseen)
    growth = (errors(engine, worse, views, views.train) - errors(engine, scene, views, views.train)).mean()
    estimated = 10.0 * np.log10((judge.unseen + growth) / judge.unseen)
    expected = (judged.sum() + WORTH * estimated.mean()) / (len(judged) + WORTH)
    assert expected > 0.5
    assert judge.original_psnr - judge.psnr(worse) == pytest.approx(expected, abs=1e-6)


def test_few_photographs_leave_a_margin(scene: Gaussians, capture: Capture, engine: Engine) -> None:
    """One standard error of the loss, if that of single photographs varies by 0.8 of the mean; none of renderings."""
    aims = []
    every = capture.frames
    for count in (0, 2, 6):
        judge = Judge.of(scene, engine, photographed(replace(capture, train=every[count:], held_out=every[:count])))
        aims.append(judge.loss_to_aim_at(0.3))
    np.testing.assert_allclose(aims, [0.3 / 1.8, 0.3 / (1.0 + 0.8 / np.sqrt(2.0)), 0.3 / 1.4])
    cameras = {frame.name: frame.camera for frame in capture.train}
    assert Judge.of(scene, engine, rendered(scene, cameras, engine, BLACK)).loss_to_aim_at(0.3) == 0.3


def test_one_lucky_rendering_does_not_make_up_for_the_others(
    scene: Gaussians, capture: Capture, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is not to be worse than another scene must not be so on the median view either."""
    cameras = {f"{turn}{frame.name}": frame.camera for turn in range(3) for frame in capture.frames}
    own = rendered(scene, cameras, engine, BLACK)
    assert len(own.judges) >= 3
    least = replace(scene, opacity_logits=scene.opacity_logits - 0.1)
    judge = Judge.of(scene, engine, own).expecting(least)
    assert judge.least is not None
    assert judge.psnr(least) == pytest.approx(judge.least.mean(), abs=1e-9)
    gains = np.full(len(own.judges), -0.5)
    gains[0] = 40.0
    squared = 10.0 ** (-0.1 * (judge.least + gains))
    monkeypatch.setattr("pocketgs.compression.judgement.errors", lambda *arguments: squared)
    assert judge.psnr(scene) == pytest.approx(judge.least.mean() - 0.5, abs=1e-6)
    assert Judge.of(scene, engine, own).psnr(scene) > judge.least.mean()


@pytest.mark.usefixtures("_few_steps")
def test_the_search_leaves_the_margin(scene: Gaussians, views: Views, engine: Engine) -> None:
    judge = Judge.of(scene, engine, views)
    found = compress(scene, views, engine, CompressionOptions(quality=1.0), seconds=0.5)
    assert isinstance(found.bound, QualityBound)
    assert found.bound.psnr == pytest.approx(judge.original_psnr - judge.loss_to_aim_at(1.0), abs=1e-6)


def test_without_held_out_photographs_training_views_decide(scene: Gaussians, capture: Capture, engine: Engine) -> None:
    judge = Judge.of(scene, engine, photographed(replace(capture, held_out=[])))
    worse = replace(scene, opacity_logits=scene.opacity_logits - 1.0)
    assert judge.psnr(worse) < judge.original_psnr - 0.5
    assert judge.psnr(scene) == pytest.approx(judge.original_psnr)
