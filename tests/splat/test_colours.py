"""Colour transforms: gradients, the CPU engine against the reference, reproducibility, and learned transforms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.colours import CHANGE, COLUMNS, UPDATES, no_transforms, transforms_of
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.reference.colours import transformed, transformed_backward
from pocketgs.splat.reference.loss import photometric_loss
from pocketgs.splat.settings import LossSettings, StepSettings
from splat.coloured_steps import COLOURED, LEARNING, colours_after_a_checked_step, frames_of, state_with
from splat.training_step import assert_identical, begin, camera_in_front, photograph

MakeGaussians = Callable[..., Gaussians]


@pytest.mark.parametrize("settings", [LossSettings("l2"), LossSettings("l1-dssim", 0.3)])
def test_gradients_of_both_sides(settings: LossSettings) -> None:
    rng = np.random.default_rng(2)
    image, photo = rng.random((2, 14, 13, 3))
    transform = np.eye(3, 4) + rng.normal(0, 0.1, (3, 4))

    def loss(image: np.ndarray, transform: np.ndarray) -> float:
        return photometric_loss(transformed(image, transform), photo, settings)[0]

    _, d_transformed = photometric_loss(transformed(image, transform), photo, settings)
    found = transformed_backward(image, transform, d_transformed)
    arguments = (image, transform)
    places = [[tuple(rng.integers(0, image.shape)) for _ in range(10)], list(np.ndindex(3, 4))]
    for which, gradient in enumerate(found):
        for place in places[which]:
            step = np.zeros_like(arguments[which])
            step[place] = 1e-6
            ends = [
                loss(*(value + sign * step if one == which else value for one, value in enumerate(arguments)))
                for sign in (1, -1)
            ]
            assert gradient[place] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("masked", [False, True])
def test_a_step_agrees_with_the_reference(camera: Camera, make_gaussians: MakeGaussians, masked: bool) -> None:
    gaussians = make_gaussians(count=60, sh_degree=1, size=0.15)
    colours = colours_after_a_checked_step(CpuEngine(2), gaussians, photograph(camera, masked))
    np.testing.assert_allclose(transforms_of(colours).mean(axis=0), np.eye(3, 4), atol=1e-7)


def test_same_bits_on_any_number_of_threads_and_after_a_break(make_gaussians: MakeGaussians) -> None:
    gaussians, frames = make_gaussians(count=500, sh_degree=1, size=0.1), frames_of(camera_in_front(75, 50, 80.0))

    def train(engine: CpuEngine, steps: range) -> OptimiserState:
        for step in steps:
            engine.step(step % len(frames), COLOURED)
        return engine.optimiser_state()

    first = begin(CpuEngine(2), gaussians, frames)
    whole = train(first, range(8))
    for threads in (1, 2):
        begun = begin(CpuEngine(threads), gaussians, frames)
        state = train(begun, range(4))
        resumed = CpuEngine(threads)
        resumed.set_views(frames)
        resumed.upload(begun.download(), state)
        ended = train(resumed, range(4, 8))
        assert_identical(resumed.download(), first.download())
        assert ended.colours is not None
        assert whole.colours is not None
        assert ended.colours.tobytes() == whole.colours.tobytes()


def test_exposures_and_white_balances_are_found(make_gaussians: MakeGaussians) -> None:
    """Two photographs from one place, one brighter and warmer than the other."""
    camera = camera_in_front(64, 48, 60.0)
    scene = make_gaussians(count=150, sh_degree=0, size=0.3, seed=1)
    shown = begin(CpuEngine(1), scene).render(camera).image
    gains = np.array([[1.15, 1.0, 0.9], [0.85, 1.0, 1.1]])
    frames = [
        Frame(f"{number}", camera, np.rint(255 * np.clip(0.8 * shown * gain, 0, 1)).astype(np.uint8))
        for number, gain in enumerate(gains)
    ]
    scene.sh[:] = 0.8 * scene.sh - 0.1 / 0.28209479
    engine = begin(CpuEngine(1), scene, frames)
    settings = replace(COLOURED, rates=COLOURED.rates.scaled(0.0), colours=replace(LEARNING, rate=0.01, weight=0.0))
    for step in range(200):
        engine.step(step % 2, settings)
    found = engine.optimiser_state().colours
    assert found is not None
    corrected = [transformed(0.8 * shown.astype(np.float64), transform) for transform in transforms_of(found)]
    for image, gain in zip(corrected, gains, strict=True):
        assert np.abs(image - 0.8 * shown * gain).mean() < 0.01


def test_steps_without_colours_leave_them_alone(camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=20)
    engine = begin(CpuEngine(1), gaussians, [photograph(camera)])
    engine.step(0, StepSettings(COLOURED.rates))
    assert engine.optimiser_state().colours is None
    engine.step(0, COLOURED)
    colours = engine.optimiser_state().colours
    assert colours is not None
    assert colours[:, UPDATES].tolist() == [1.0]
    # The only photograph's transform is the mean of all.
    assert not colours[:, CHANGE].any()
    engine.set_views([photograph(camera)])
    assert engine.optimiser_state().colours is None


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (no_transforms(2), "expected float32 \\(1, 37\\)"),
        (np.zeros((1, COLUMNS)), "are float64"),
        (np.full((1, COLUMNS), np.nan, np.float32), "NaN"),
    ],
)
def test_transforms_of_other_photographs_are_refused(
    camera: Camera, make_gaussians: MakeGaussians, table: np.ndarray, message: str
) -> None:
    gaussians = make_gaussians(count=5)
    engine = CpuEngine(1)
    engine.set_views([photograph(camera)])
    with pytest.raises(PocketGSError, match=message):
        engine.upload(gaussians, state_with(gaussians, table))
