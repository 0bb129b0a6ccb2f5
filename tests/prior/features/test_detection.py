"""Features of all frames: on larger photographs where there are any, in the frame's own pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame, Result
from pocketgs.capture.frame_edits import cropped, downscaled
from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.features import detection
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.detection import detect_all, detection_side

MOST = 500
FINDER = CpuFinder()


@dataclass(frozen=True)
class Enlarged:
    """Photographs that are in memory, larger than the frames."""

    frames: list[Frame]

    @property
    def longest_side(self) -> int:
        return max(max(frame.camera.width, frame.camera.height) for frame in self.frames)

    def map(self, look: Callable[[Frame], Result], max_size: int) -> dict[str, Result]:
        return {frame.name: look(downscaled(frame, 1.0, max_size)) for frame in self.frames}


@pytest.fixture(scope="module")
def photographs() -> list[Frame]:
    capture = true_capture(width=240, height=180, frames=3, points=1)
    return [replace(frame, depth=None) for frame in capture.frames]


def test_larger_photographs_give_features_in_the_frames_pixels(photographs: list[Frame]) -> None:
    frames = [downscaled(cropped(photo, 20, 10, 200, 160), 2.0, None) for photo in photographs]
    for frame, photo, found in zip(
        frames, photographs, detect_all(frames, MOST, FINDER, Enlarged(photographs)), strict=True
    ):
        expected = (FINDER.detect(photo, MOST).pixels - (20, 10)) / 2
        inside = np.all((expected >= 0) & (expected < (frame.camera.width, frame.camera.height)), axis=1)
        np.testing.assert_allclose(found.pixels, expected[inside], atol=1e-9)
        assert found.grain == pytest.approx(0.5)
        assert len(found.pixels) > 1.5 * len(FINDER.detect(frame, MOST).pixels)


def test_frames_as_large_as_their_photographs_are_looked_at_themselves(photographs: list[Frame]) -> None:
    class Untouched(Enlarged):
        def map(self, look: Callable[[Frame], Result], max_size: int) -> dict[str, Result]:
            raise AssertionError("decoded again")

    found = detect_all(photographs, MOST, FINDER, Untouched(photographs))
    np.testing.assert_array_equal(found[0].pixels, FINDER.detect(photographs[0], MOST).pixels)
    assert [features.grain for features in found] == [1.0] * len(photographs)


def test_many_pixels_are_reduced(photographs: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detection, "PIXELS", 120 * 90 * len(photographs))
    for frame, found in zip(photographs, detect_all(photographs, MOST, FINDER), strict=True):
        assert found.grain == pytest.approx(2.0)
        assert found.pixels.max() > 120
        assert np.all(found.pixels < (frame.camera.width, frame.camera.height))


def test_many_frames_have_fewer_features_each(photographs: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    usual = detect_all(photographs, 50, FINDER)
    monkeypatch.setattr(detection, "FEATURES", 30 * len(photographs))
    fewer = detect_all(photographs, 50, FINDER)
    assert all(len(features.pixels) <= 30 < len(more.pixels) for features, more in zip(fewer, usual, strict=True))


def test_no_frames() -> None:
    assert detect_all([], MOST, FINDER) == []


def test_no_image_has_more_pixels_than_the_finder_takes() -> None:
    """Nor a square one among wide ones, which has most pixels for its longer side."""
    assert detection_side([(1280, 720)] * 3, 360 * 640) == 640
    assert detection_side([(1280, 720)] * 3 + [(1280, 1280)], 500**2) == 500
