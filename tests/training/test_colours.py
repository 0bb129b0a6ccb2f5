"""Learned colour transforms: speed of learning, checkpoints, and the cost of exposure jumps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.synthetic.phone import expose, photograph, plan_shots
from pocketgs.capture.synthetic.room import room
from pocketgs.capture.synthetic.tracing import Scene
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.metrics.evaluation import Evaluation
from pocketgs.results.checkpoint import CHECKPOINT, read_checkpoint, write_checkpoint
from pocketgs.results.held_out import evaluate_held_out
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.colours import UPDATES, transforms_of
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import StepSettings
from pocketgs.training.colours import RATE
from pocketgs.training.options import TrainingOptions
from pocketgs.training.progress import Progress
from pocketgs.training.result import Checkpoint
from pocketgs.training.train import train

OPTIONS = TrainingOptions(iterations=12, prior="none", colours="on", engine="cpu", evaluate_every=0)


def flickering(capture: Capture) -> Capture:
    """The capture with random exposure and white balance for each photograph."""
    rng = np.random.default_rng(4)
    return replace(capture, train=[exposed(frame, rng.uniform(0.8, 1.2, 3)) for frame in capture.train])


def exposed(frame: Frame, gains: np.ndarray) -> Frame:
    return replace(frame, image=np.rint(np.clip(frame.image * gains, 0, 255)).astype(np.uint8))


def test_wishes_that_there_are_not_are_refused() -> None:
    with pytest.raises(PocketGSError, match="colours: found maybe, expected on or off"):
        TrainingOptions(colours="maybe")  # type: ignore[arg-type]


def test_the_rate_falls_with_the_others(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = create_engine(EngineOptions("cpu"))
    taken: list[StepSettings] = []
    take_step = engine.step

    def step(view: int, settings: StepSettings) -> None:
        taken.append(settings)
        take_step(view, settings)

    monkeypatch.setattr(engine, "step", step)
    result = train(flickering(small_capture), OPTIONS, opened_engine=engine)
    rates = [settings.colours.rate for settings in taken if settings.colours]
    assert len(rates) == 12
    assert rates[0] == RATE
    assert rates == sorted(rates, reverse=True)
    table = result.checkpoint.state.colours
    assert table is not None
    assert table[:, UPDATES].sum() == 12
    np.testing.assert_allclose(transforms_of(table).mean(axis=0), np.eye(3, 4), atol=1e-6)
    taken.clear()
    train(small_capture, replace(OPTIONS, colours="off"), opened_engine=engine)
    assert {settings.colours for settings in taken} == {None}


def test_a_run_goes_on_from_its_checkpoint_to_the_same_bits(small_capture: Capture, tmp_path: Path) -> None:
    capture, kept = flickering(small_capture), []

    def observe(progress: Progress) -> None:
        if progress.iteration == 5:
            kept.append(progress.checkpoint())

    whole = train(capture, OPTIONS, observer=observe)
    write_checkpoint(tmp_path / CHECKPOINT, kept[0], {})
    read: Checkpoint = read_checkpoint(tmp_path, {})
    assert read.state.colours is not None
    assert read.state.colours.tobytes() == kept[0].state.colours.tobytes()
    resumed = train(capture, OPTIONS, resume=read)
    assert resumed.scene.sh.tobytes() == whole.scene.sh.tobytes()
    assert resumed.checkpoint.state.colours is not None
    assert whole.checkpoint.state.colours is not None
    assert resumed.checkpoint.state.colours.tobytes() == whole.checkpoint.state.colours.tobytes()


@pytest.mark.slow
def test_jumping_colours_cost_little(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The demo's room from the true poses, as it is, and with random exposure and white balance."""
    light: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def expose_once(scene: Scene, camera: Camera, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = poses.tobytes()
        light[key] = light.get(key) or expose(scene, camera, poses)
        return light[key]

    monkeypatch.setattr("pocketgs.capture.synthetic.phone.expose", expose_once)
    scene, rng = room(), np.random.default_rng(3)
    shots = plan_shots(160, 120, 32)
    gains = [np.exp(rng.uniform(-0.25, 0.25) + rng.uniform(-0.12, 0.12, 3)) for _ in shots]

    @cache
    def capture(jumps: bool) -> Capture:
        taken = [
            replace(shot, gain=gain if jumps and not shot.held_out else np.ones(3))
            for shot, gain in zip(shots, gains, strict=True)
        ]
        frames = [Frame(f"{shot.index:04d}", shot.camera, photograph(scene, shot)[0]) for shot in taken]
        held_out = [frame for frame, shot in zip(frames, shots, strict=True) if shot.held_out]
        trained = [frame for frame, shot in zip(frames, shots, strict=True) if not shot.held_out]
        return Capture("room", tmp_path, "synthetic", trained, held_out, metric=True)

    def trained(jumps: bool, **options: Any) -> Evaluation:
        engine = create_engine(EngineOptions("cpu"))
        train(capture(jumps), opened_engine=engine, iterations=180, max_gaussians=6_000, bundle=False, **options)
        evaluation = evaluate_held_out(engine, capture(jumps))
        assert evaluation is not None
        print(f"jumps {jumps}, {options}: {evaluation.psnr:.2f} dB, colour-corrected {evaluation.cc_psnr:.2f} dB")
        return evaluation

    clean, jumping = trained(False), trained(True)
    assert jumping.cc_psnr > clean.cc_psnr - 0.3
    assert jumping.psnr > trained(True, exposure="off").psnr + 0.3


def test_the_rate_falls_in_proportion_to_that_of_the_scenes_colours(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the last photographs that are trained on would set the scene's colours."""
    engine = create_engine(EngineOptions("cpu"))
    taken: list[tuple[float, float]] = []
    take_step = engine.step

    def step(view: int, settings: StepSettings) -> None:
        assert settings.colours is not None
        taken.append((settings.colours.rate, settings.rates.sh_dc))
        take_step(view, settings)

    monkeypatch.setattr(engine, "step", step)
    train(flickering(small_capture), OPTIONS, opened_engine=engine)
    rates, of_scene = np.array(taken).T
    np.testing.assert_allclose(rates / RATE, of_scene / of_scene[0])
    assert rates[-1] < 0.1 * RATE
