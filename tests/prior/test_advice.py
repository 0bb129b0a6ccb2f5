"""Hints depend on the content of photographs, not on their size or masks."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pocketgs.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.advice import FEW, check_photographs, exposure_hint, photograph_hints, poses_hint
from pocketgs.prior.scale import METRIC_DISTANCE, estimate_scale

PAGE = (Path(__file__).parents[2] / "docs" / "photographing.md").read_text(encoding="utf-8")


def frames_of(image: np.ndarray, count: int = FEW) -> list[Frame]:
    height, width = image.shape[:2]
    camera = Camera(width, height, width, width, width / 2, height / 2, np.eye(4))
    return [Frame(f"{number}.png", camera, image) for number in range(count)]


def noise(shape: tuple[int, ...], level: float, spread: float) -> np.ndarray:
    values = np.random.default_rng(1).normal(level, spread, shape)
    return np.clip(values, 0, 255).astype(np.uint8)


def test_good_photographs_need_no_hint(small_capture: Capture) -> None:
    assert photograph_hints(small_capture.train * 2) == ()


@pytest.mark.parametrize("size", [(90, 120), (600, 800)])
def test_noise_on_a_wall_is_no_texture(size: tuple[int, int]) -> None:
    (hint,) = photograph_hints(frames_of(noise((*size, 3), 200, 3)))
    assert f"{FEW} of {FEW} photographs have little texture" in hint


def test_dark_photographs(small_capture: Capture) -> None:
    """They have little texture because they are dark: no other remedy is proposed."""
    dark = [replace(frame, image=frame.image // 6) for frame in small_capture.train * 2]
    (hint,) = photograph_hints([*dark, *frames_of(noise((90, 120, 3), 20, 3), 4)])
    assert "photographs are dark" in hint


def test_masked_pixels_do_not_count(small_capture: Capture) -> None:
    frame = small_capture.train[0]
    image, mask = frame.image.copy(), np.ones(frame.image.shape[:2], bool)
    image[:, :48], mask[:, 48:] = 180, False
    assert photograph_hints([replace(frame, image=image)] * FEW) == ()
    (hint,) = photograph_hints([replace(frame, image=image, mask=mask)] * FEW)
    assert "little texture" in hint
    assert photograph_hints([replace(frame, mask=np.zeros_like(mask))] * FEW) == ()


def test_few_photographs_are_worth_a_hint_and_fewer_an_error(small_capture: Capture) -> None:
    (hint,) = photograph_hints(small_capture.train[:7])
    assert "only 7 photographs" in hint
    two = replace(small_capture, train=small_capture.train[:2], held_out=[])
    check_photographs(two)  # its points help
    bare = [replace(frame, depth=None) for frame in two.train]
    with pytest.raises(PocketGSError, match="only 2 photographs, expected at least 3"):
        check_photographs(replace(two, train=bare, points=None))


def test_exposure_counts_in_stops() -> None:
    assert exposure_hint(None) == ()
    assert exposure_hint(np.array([[0.9, 1.0, 1.0], [1.0, 1.0, 1.1]])) == ()
    assert "differs by 2.2 stops" in exposure_hint(np.array([[0.7, 0.7, 0.7], [1.4, 1.4, 1.4]]))[0]


def test_hints_say_what_to_do_and_stand_on_the_page() -> None:
    """As they are, but for the numbers; and without a file to look up, which is not installed."""
    dark, dull = noise((90, 120, 3), 20, 1), noise((90, 120, 3), 200, 3)
    hints = (
        *photograph_hints([*frames_of(dark, 2), *frames_of(dull, 2)]),
        *exposure_hint(np.array([[0.5, 1.0, 2.0]])),
        *poses_hint(wrong=9, frames=20),
    )
    assert len(hints) == 5
    for hint in hints:
        assert f"warning: {without_numbers(hint)}\n" in without_numbers(PAGE)
        assert "docs" not in hint


def without_numbers(text: str) -> str:
    return re.sub(r"[\d.]+(?= )", "N", text)


@pytest.mark.parametrize("metric", [True, False])
def test_axes_that_meet_in_the_camera_say_nothing_of_distance(small_capture: Capture, metric: bool) -> None:
    eye = np.array([0.3, -1.2, 1.5])
    turned = []
    for frame in small_capture.train:
        pose = frame.camera.world_to_camera.copy()
        pose[:3, 3] = -pose[:3, :3] @ eye
        turned.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    scale = estimate_scale(replace(small_capture, train=turned, points=None, metric=metric))
    assert scale.distance == (METRIC_DISTANCE if metric else 1.0)
