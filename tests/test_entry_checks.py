"""The API checks its inputs once, before kernels that check nothing read them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pocketgs.scene.formats  # noqa: F401
from pocketgs import Camera, PocketGSError, render
from pocketgs.capture import Capture, Frame, open_capture
from pocketgs.scene.background import checked_background
from pocketgs.scene.edits import scaled, translated
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import EngineOptions, OptimiserState
from pocketgs.splat.settings import (
    AdamSettings,
    ColourSettings,
    Dropout,
    LearningRates,
    LossSettings,
    PositionNoise,
    StepSettings,
)
from pocketgs.training.options import TrainingOptions

CAMERA = Camera(32, 16, 30.0, 30.0, 16.0, 8.0, np.eye(4))
IMAGE = np.zeros((16, 32, 3), np.uint8)
RATES = LearningRates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def scene(count: int = 4) -> Gaussians:
    return Gaussians(
        np.ones((count, 3)), np.zeros((count, 3)), np.ones((count, 4)), np.zeros(count), np.zeros((count, 1, 3))
    )


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"image": np.zeros((15, 32, 3), np.uint8)}, "image is uint8 (15, 32, 3)"),
        ({"image": np.zeros((0, 32, 3), np.uint8)}, "image is uint8 (0, 32, 3)"),
        ({"image": np.zeros((16, 32), np.uint8)}, "image is uint8 (16, 32)"),
        ({"image": np.zeros((16, 32, 3), np.float32)}, "image is float32 (16, 32, 3)"),
        ({"image": None}, "image is NoneType"),
        ({"alpha": np.zeros((16, 31), np.uint8)}, "alpha is uint8 (16, 31)"),
        ({"mask": np.zeros((16, 32), np.uint8)}, "mask is uint8 (16, 32)"),
        ({"mask": np.zeros((8, 32), np.bool_)}, "mask is bool (8, 32)"),
        ({"depth": np.zeros((16, 32), np.float64)}, "depth is float64 (16, 32)"),
        ({"depth": np.full((16, 32), np.nan, np.float32)}, "depth holds NaN or infinity"),
        ({"camera": "none"}, "camera is str"),
    ],
)
def test_frames(changes: dict[str, Any], found: str) -> None:
    with pytest.raises(PocketGSError) as raised:
        Frame(**{"name": "a.png", "camera": CAMERA, "image": IMAGE, **changes})
    assert found in str(raised.value)
    assert "frame 'a.png'" in str(raised.value)
    assert "expected" in str(raised.value)


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"width": 0}, "image size 0x16"),
        ({"width": 32.0}, "image size 32x16"),
        ({"width": 10**400}, "image size 1000"),
        ({"height": 10**8}, "image size 32x100000000"),
        ({"fx": float("nan")}, "fx, fy, cx, cy = nan"),
        ({"fy": -1.0}, "30, -1"),
        ({"cx": "far"}, "not numbers"),
        ({"cy": 10**400}, "not numbers"),
        ({"world_to_camera": np.eye(3)}, "not a 4x4 matrix"),
        ({"world_to_camera": [[1, 2], [3]]}, "not numbers"),
        ({"world_to_camera": None}, "not a 4x4 matrix"),
    ],
)
def test_cameras(changes: dict[str, Any], found: str) -> None:
    with pytest.raises(PocketGSError) as raised:
        replace(CAMERA, **changes)
    assert found in str(raised.value)
    assert len(str(raised.value)) < 300


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("means", np.zeros(4)),
        ("means", "far"),
        ("means", [[1, 2, 3], [4]]),
        ("sh", np.zeros((4, 2, 3))),
        ("quaternions", np.zeros((4, 4), complex)),
        ("opacity_logits", None),
        ("log_scales", np.zeros((3, 3))),
    ],
)
def test_gaussians(name: str, values: Any) -> None:
    with pytest.raises(PocketGSError, match=f"Gaussians: {name} |Gaussians: .* expected"):
        replace(scene(), **{name: values})


@pytest.mark.parametrize(
    "background",
    [(float("nan"), 0, 0), (0, 0), (0, 0, 0, 0), (0, 0, 1.5), (-0.1, 0, 0), "red", None, (0, "1", None), 0],
)
def test_backgrounds(background: Any, small_capture: Capture, written_capture: Any) -> None:
    expected = pytest.raises(PocketGSError, match=r"background: found .*, expected three numbers from 0 to 1")
    with expected:
        checked_background(background)
    with expected:
        render(scene(), CAMERA, background, engine=EngineOptions("cpu"))
    with expected:
        StepSettings(RATES, background=background)
    with expected:
        replace(small_capture, background=background)
    if background is not None:
        with expected:
            open_capture(written_capture, background=background)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LossSettings("mse"), "loss: found 'mse', expected l2 or l1-dssim"),  # type: ignore[arg-type]
        (lambda: LossSettings(dssim_weight=1.1), "structural share of 1.1, expected one from 0 to 1"),
        (lambda: LossSettings(dssim_weight=float("nan")), "structural share of nan"),
        (lambda: LossSettings(scale_weight=-1.0), "scale_weight of -1.0, expected a finite number"),
        (lambda: LossSettings(opacity_weight=float("inf")), "opacity_weight of inf"),
        (lambda: LossSettings(size_weight=float("nan")), "size_weight of nan"),
        (lambda: AdamSettings(beta1=1.0), "beta1 of 1.0, expected one from 0 to below 1"),
        (lambda: AdamSettings(beta2=-0.1), "beta2 of -0.1, expected one from 0 to below 1"),
        (lambda: AdamSettings(epsilon=0.0), "epsilon of 0.0, expected a positive number"),
        (lambda: replace(RATES, means=-1.0), "rate of means of -1.0"),
        (lambda: replace(RATES, sh_rest=float("nan")), "rate of sh_rest of nan"),
        (lambda: ColourSettings(-1e-3), "rate of colours of -0.001"),
        (lambda: ColourSettings(1e-3, float("nan")), "weight of colours of nan"),
        (lambda: PositionNoise(float("nan"), 0), "size of the noise of nan"),
        (lambda: PositionNoise(1.0, -1), "noise: found the seed -1, expected 0 to 4294967295"),
        (lambda: Dropout(0.1, 2**32), "dropout: found the seed 4294967296"),
        (lambda: Dropout(1.0, 0), "share of 1.0, expected one from 0 to below 1"),
        (lambda: StepSettings(RATES, sh_degree=4), "sh_degree of 4, expected 0 to 3"),
        (lambda: StepSettings(RATES, sh_degree=-1), "sh_degree of -1, expected 0 to 3"),
    ],
)
def test_settings_of_steps(make: Callable[[], object], message: str) -> None:
    with pytest.raises(PocketGSError, match=message):
        make()


def test_a_background_may_be_any_three_numbers() -> None:
    assert checked_background(np.array([0, 1, 0.5], np.float32)) == (0.0, 1.0, 0.5)


def test_uploads_and_steps() -> None:
    engine = create_engine(EngineOptions("cpu"))
    with pytest.raises(PocketGSError, match="expected Gaussians"):
        engine.upload("scene")  # type: ignore[arg-type]
    changed = scene()
    changed.sh = np.zeros((3, 1, 3), np.float32)
    with pytest.raises(PocketGSError, match="sh has shape"):
        engine.upload(changed)
    for moments, steps in [(np.zeros((3, 13)), 1), (np.zeros((4, 13), np.float64), 1), (np.zeros((4, 13), "f4"), -1)]:
        with pytest.raises(PocketGSError, match="upload: "):
            engine.upload(scene(), OptimiserState(moments, moments, steps))
    engine.set_views([Frame("a", CAMERA, IMAGE)])
    engine.upload(scene())
    for view in (1, -1):
        with pytest.raises(PocketGSError, match=f"found view {view}, expected 0 to 0"):
            engine.step(view, StepSettings(RATES))


@pytest.mark.parametrize("factor", [1e39, 4e38, 1e308, 1e-320, 0.0, -1.0, float("nan"), float("inf")])
def test_scales_that_scenes_cannot_hold(factor: float) -> None:
    with pytest.raises(PocketGSError, match=r"scale .*beyond what scenes can hold|scale .*expected a positive number"):
        scaled(scene(), factor)


def test_moves_that_scenes_cannot_hold() -> None:
    for offset in ([1e39, 0, 0], [0, np.nan, 0], [0, 0, -np.inf]):
        with pytest.raises(PocketGSError, match=r"translation .*(beyond what scenes can hold|finite)"):
            translated(scene(), np.array(offset))
    broken = scene()
    broken.means[0] = np.nan
    assert np.isfinite(translated(scaled(broken, 2.0), np.ones(3)).means[1:]).all(), "what was broken is no reason"


@pytest.mark.parametrize("seconds", [float("inf"), float("nan"), -float("inf"), 0.0])
def test_time_budgets(seconds: float) -> None:
    with pytest.raises(PocketGSError, match="time budget: found"):
        TrainingOptions(time_budget=seconds)


@pytest.mark.parametrize("options", [{"threads": 0}, {"threads": -1}, {"max_memory": 0}])
def test_engine_options(options: dict[str, int]) -> None:
    with pytest.raises(PocketGSError, match="expected at least 1"):
        EngineOptions(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("precision", "f8", "f32 or f16"),
        ("replay", "x", "recompute or cache"),
        ("accumulation", "y", "ordered or atomic"),
        ("accumulation", None, "ordered or atomic"),
    ],
)
def test_unknown_engine_settings(name: str, value: str | None, expected: str) -> None:
    with pytest.raises(PocketGSError, match=f"^{name}: found {value!r}, expected {expected}$"):
        EngineOptions(**{name: value})  # type: ignore[arg-type]
