"""Complete runs on captures with one mistake each: a usable scene, or an error that says what to photograph
differently.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mistakes import STRANGER, noiseless, write_mistake
from pocketgs.capture import Capture, list_capture
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.metrics.evaluation import psnr
from pocketgs.prior.report import PriorReport
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.splat.rendering import render_all
from pocketgs.training.options import TrainingOptions

# The memory of tests that ran before in this process counts too.
OPTIONS = TrainingOptions(effort="quick", iterations=200, max_gaussians=15_000, engine="cpu", max_memory=10_000)
FOG = 4.0
"""Pixels, of 160 in a row, by which a photograph is blurred to look like a fogged scene."""

GOOD, USABLE = 4.0, 2.0
"""Decibels by which a scene must be nearer to the truth than fog is."""

PAGE = Path(__file__).parents[1] / "docs" / "photographing.md"


@dataclass
class Attempt:
    """Result of a run.

    Attributes:
        gain: mean PSNR in dB of held-out views against what was there to see by day, beyond that of fog.
        said: warnings.
        summary: content of `run.json`.
    """

    gain: float = np.nan
    said: list[str] = field(default_factory=list)
    summary: dict[str, Any] = field(default_factory=dict)

    def was_told(self, words: str, part: str) -> bool:
        """Whether a warning holds the words, which a part of the page explains."""
        (explained,) = re.findall(rf"^## {part}$(.*?)(?=^## )", PAGE.read_text(), re.MULTILINE | re.DOTALL)
        return any(words in warning for warning in self.said) and words in explained


@pytest.fixture(scope="module")
def attempt(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Attempt]:
    """A function that makes a capture with a mistake, trains on it and returns the outcome."""

    @lru_cache
    def made(mistake: str) -> Attempt:
        folder = tmp_path_factory.mktemp(mistake)
        shots = write_mistake(mistake, folder / "capture")
        found = Attempt()

        def prepared(capture: Capture) -> None:
            held_out.extend((frame.name, frame.camera) for frame in capture.held_out)

        def told(report: PriorReport) -> None:
            found.said.extend(report.warnings)

        held_out: list[tuple[str, Camera]] = []
        reporter = Reporter(on_prior=told, on_prepared=prepared, on_warning=found.said.append)
        result = run(lambda: list_capture(folder / "capture"), folder / "result", OPTIONS, reporter=reporter)
        found.summary = result.summary
        for array in (result.scene.means, result.scene.log_scales, result.scene.sh, result.scene.opacity_logits):
            assert np.isfinite(array).all()
        views = render_all(result.scene, [camera for _, camera in held_out], engine=OPTIONS.engine_options)
        gains = []
        for (name, _), view in zip(held_out, views, strict=True):
            shot = shots[int(Path(name).stem)]
            truth, shown = (np.clip(image / shot.gain, 0, 1) for image in (noiseless(shot), view.image))
            gains.append(psnr(shown, truth) - psnr(cv2.GaussianBlur(truth, (0, 0), FOG), truth))
        found.gain = float(np.mean(gains))
        print(f"{mistake}: {found.gain:.2f} dB, {found.said}")
        return found

    return made


def test_without_a_mistake(attempt: Callable[[str], Attempt]) -> None:
    good = attempt("none")
    assert good.gain > GOOD
    assert good.said == []
    assert good.summary["contradicted_views"] is None


def test_turning_on_the_spot(attempt: Callable[[str], Attempt]) -> None:
    turning = attempt("turning")
    assert turning.gain > GOOD
    assert turning.was_told("from nearly one place", "Turning on the spot")


def test_two_photographs(attempt: Callable[[str], Attempt]) -> None:
    with pytest.raises(PocketGSError, match="only 2 photographs, expected at least 3 and better 30 to 60"):
        attempt("two")


@pytest.mark.slow
def test_duplicates(attempt: Callable[[str], Attempt]) -> None:
    assert attempt("duplicates").gain > GOOD


def test_blank_walls(attempt: Callable[[str], Attempt]) -> None:
    blank = attempt("blank")
    assert blank.gain > GOOD
    assert blank.was_told("too little texture", "Blank walls")


def test_half_the_poses_wrong(attempt: Callable[[str], Attempt]) -> None:
    displaced = attempt("displaced")
    assert displaced.gain > USABLE
    assert displaced.was_told("poses were wrong", "When some poses are wrong")
    views = {image["name"]: image["psnr"] for image in displaced.summary["images"]}
    [kept, moved] = views
    contradicted = displaced.summary["contradicted_views"]
    assert contradicted["names"] == [moved]
    assert contradicted["means_without"]["psnr"] == views[kept]


def test_a_photograph_of_another_place(attempt: Callable[[str], Attempt]) -> None:
    stranger = attempt("stranger")
    assert stranger.gain > GOOD
    assert any("left out" in warning and f"{STRANGER:04d}.png" in warning for warning in stranger.said)


def test_exposure_that_alternates(attempt: Callable[[str], Attempt]) -> None:
    flicker = attempt("flicker")
    assert flicker.gain > USABLE
    assert flicker.was_told("stops between photographs", "Exposure that jumps")
    least, largest = flicker.summary["prior"]["gains"]
    assert largest > 2.0 * least


@pytest.mark.slow
def test_a_mirror(attempt: Callable[[str], Attempt]) -> None:
    assert attempt("mirror").gain > GOOD


def test_night(attempt: Callable[[str], Attempt]) -> None:
    night = attempt("night")
    assert night.gain > USABLE
    assert night.was_told("are dark", "Too dark")
