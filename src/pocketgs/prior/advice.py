"""Hints for better photographs, derived from the photographs and from what could be reconstructed.

Every hint says itself what to do; docs/photographing.md, which is not installed, shows each mistake and its remedy.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError, counted
from pocketgs.prior.scale import Scale

FEWEST, FEW = 3, 12
"""Number of photographs without which shapes cannot be estimated, and below which much remains a guess."""

MIN_WALK = 0.02
"""Minimum spread of the cameras as a share of the distance to the scene; below it they stand in one place."""

LOOKED_AT = 320
"""Longer side in pixels of the copies that are analysed."""

CELL = 16
"""Side in pixels of the cells in which texture is measured."""

FINE, COARSE = 1.5, 4.0
"""Standard deviations of two blurs. Their difference keeps texture and removes most noise and soft shadows."""

MIN_CONTRAST = 2.0
"""Minimum standard deviation of this difference, in grey levels, in a textured cell."""

MIN_TEXTURED = 0.25
"""Minimum share of textured cells in a photograph with texture."""

HIGHLIGHT, DARK = 98, 90
"""Percentile of grey levels that counts as the brightest, and the level below which a photograph is dark."""

MANY = 0.2
"""Share of photographs with a mistake above which a hint is given."""

DISPLAY_GAMMA = 2.2
STOPS = 1.0
"""Difference in exposure, in stops, above which a hint is given."""


def check_photographs(capture: Capture) -> None:
    """Refuse captures that no scene can be made from.

    Raises:
        PocketGSError: there are too few photographs, and neither points nor depths to compensate.
    """
    helped = capture.points is not None or any(frame.depth is not None for frame in capture.frames)
    if len(capture.frames) < FEWEST and not helped:
        found = counted(len(capture.frames), "photograph", "photographs")
        expected = f"expected at least {FEWEST} and better 30 to 60, each a step to the side of the last"
        raise PocketGSError(f"{capture.path}: only {found}, {expected}")


def photograph_hints(frames: Sequence[Frame]) -> tuple[str, ...]:
    """Hints from the photographs alone: too few, dark, or without texture although they are bright.

    Args:
        frames: all frames of a capture.
    """
    hints = []
    if len(frames) < FEW:
        found = counted(len(frames), "photograph", "photographs")
        hints.append(f"only {found}: gaps between them are guessed; take 30 to 60 of an object, 100 to 200 of a room")
    looks = [_look(frame) for frame in frames]
    dark = sum(is_dark for _, is_dark in looks)
    blank = sum(is_blank and not is_dark for is_blank, is_dark in looks)
    if dark > MANY * len(frames):
        hints.append(f"{dark} of {len(frames)} photographs are dark: switch on the lights or take them by day")
    if blank > MANY * len(frames):
        hints.append(
            f"{blank} of {len(frames)} photographs have little texture: step back until something patterned is in view"
        )
    return tuple(hints)


def exposure_hint(gains: np.ndarray | None) -> tuple[str, ...]:
    """A hint if exposures differ much.

    Args:
        gains: (F, 3) factor on the display values of each photograph, or None if they were not measured.
    """
    stops = 0.0 if gains is None else DISPLAY_GAMMA * float(np.log2(gains.max() / gains.min()))
    if stops < STOPS:
        return ()
    how = "lock it, on most phones by a long tap on the screen"
    return (f"exposure differs by {stops:.1f} stops between photographs: {how}",)


def poses_hint(wrong: int, frames: int) -> tuple[str, ...]:
    """A hint if many of a capture's poses are wrong."""
    if wrong <= MANY * frames:
        return ()
    remedy = "let pocketgs pose find them anew, or record again, slowly, with textured objects in view"
    return (f"{wrong} of {frames} poses were wrong: {remedy}",)


def nothing_found(capture: Capture, scale: Scale) -> str:
    """Why no points were found, and how to photograph instead."""
    centres = np.array([frame.camera.centre for frame in capture.frames])
    if np.ptp(centres, axis=0).max() < MIN_WALK * scale.distance:
        return (
            "the photographs were taken from nearly one place, which does not determine distances: poses are used as "
            "given; walk around the subject, with a step to the side between photographs"
        )
    return (
        "too little texture to refine poses or to estimate distances: poses are used as given; photograph without "
        "blur, in more light, with something patterned in view"
    )


def _look(frame: Frame) -> tuple[bool, bool]:
    """Whether a photograph has little texture, and whether it is dark, in the pixels that are used."""
    reduction = max(1.0, max(frame.image.shape[:2]) / LOOKED_AT)
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    size = tuple(max(CELL, round(side / reduction)) for side in (grey.shape[1], grey.shape[0]))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    used = np.ones(small.shape, bool)
    if frame.usable is not None:
        used = cv2.resize(frame.usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    if not used.any():
        return False, False
    # Blurring spreads masked pixels across the mask's border.
    inside = cv2.erode(used.astype(np.uint8), np.ones((CELL + 1, CELL + 1), np.uint8)) > 0
    fine, coarse = (cv2.GaussianBlur(small.astype(np.float32), (0, 0), sigma) for sigma in (FINE, COARSE))
    contrast = _cells(fine - coarse).std(axis=1)
    textured = contrast[_cells(inside).all(axis=1)] >= MIN_CONTRAST
    blank = bool(len(textured)) and float(textured.mean()) < MIN_TEXTURED
    return blank, float(np.percentile(small[used], HIGHLIGHT)) < DARK


def _cells(values: np.ndarray) -> np.ndarray:
    """(C, CELL²) the complete cells of (H, W) values."""
    rows, columns = values.shape[0] // CELL, values.shape[1] // CELL
    whole = values[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL)
    return whole.swapaxes(1, 2).reshape(-1, CELL * CELL)
