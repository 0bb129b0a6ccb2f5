"""What to photograph differently: hints that follow from the photographs and from what could be made of them.

Every hint names the part of docs/photographing.md that shows the mistake and what to do about it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.prior.scale import Scale

PAGE = "docs/photographing.md"

FEWEST, FEW = 3, 12
"""Photographs without which nothing can be told of shapes, and below which much stays a guess."""

MIN_WALK = 0.02
"""Share of the distance to the scene that cameras lie apart, below which they stand in one place."""

LOOKED_AT = 320
"""Pixels of the longer side of the copies that are looked at."""

CELL = 16
"""Pixels a side of the cells that texture is sought in."""

FINE, COARSE = 1.5, 4.0
"""Standard deviations of two blurs. Their difference keeps texture, and drops most noise and soft shadows."""

MIN_CONTRAST = 2.0
"""Grey levels by which this difference varies in a cell that shows texture."""

MIN_TEXTURED = 0.25
"""Share of a photograph's cells that show texture, below which it shows hardly any."""

HIGHLIGHT, DARK = 98, 90
"""Percentile of the grey levels that counts as a photograph's brightest, and the level below which it is dark."""

MANY = 0.2
"""Share of the photographs above which a mistake is worth a hint."""

DISPLAY_GAMMA = 2.2
STOPS = 1.0
"""Difference in exposure that is worth a hint."""


def check_photographs(capture: Capture) -> None:
    """Refuse what no scene can come of.

    Raises:
        PocketGSError: there are too few photographs, and neither points nor depths to help them.
    """
    helped = capture.points is not None or any(frame.depth is not None for frame in capture.frames)
    if len(capture.frames) < FEWEST and not helped:
        found = f"{len(capture.frames)} photograph{'s' if len(capture.frames) > 1 else ''}"
        expected = f"expected {FEWEST} at least and better 30 to 60, each a step to the side of the last"
        raise PocketGSError(f"{capture.path}: only {found}, {expected}; {_see('How many')}")


def photograph_hints(frames: Sequence[Frame]) -> tuple[str, ...]:
    """Hints that photographs alone give, in words: few, without texture, or dark.

    Args:
        frames: all of a capture.
    """
    hints = []
    if len(frames) < FEW:
        hints.append(
            f"only {len(frames)} photographs: what lies between them is guessed; take 30 to 60 of a thing, 100 to 200 "
            f"of a room; {_see('How many')}"
        )
    looks = [_look(frame) for frame in frames]
    blank, dark = (sum(look[which] for look in looks) for which in (0, 1))
    if dark > MANY * len(frames):
        hints.append(
            f"{dark} of {len(frames)} photographs are dark: switch on the lights or come back by day; "
            f"{_see('Too dark')}"
        )
    if blank > MANY * len(frames):
        hints.append(
            f"{blank} of {len(frames)} photographs show hardly any texture: step back until something patterned is in "
            f"view; {_see('Blank walls')}"
        )
    return tuple(hints)


def exposure_hint(gains: tuple[float, float] | None) -> tuple[str, ...]:
    """A hint where exposures differ much.

    Args:
        gains: least and greatest factor on display values, or None if they were not measured.
    """
    stops = 0.0 if gains is None else DISPLAY_GAMMA * float(np.log2(gains[1] / gains[0]))
    if stops < STOPS:
        return ()
    return (f"exposure differs by {stops:.1f} stops between photographs: lock it; {_see('Exposure that jumps')}",)


def poses_hint(wrong: int, frames: int) -> tuple[str, ...]:
    """A hint where many of a capture's poses turned out wrong."""
    if wrong <= MANY * frames:
        return ()
    return (
        f"{wrong} of {frames} poses were wrong: film again, slowly, with textured things in view; "
        f"{_see('When some poses are wrong')}",
    )


def nothing_found(capture: Capture, scale: Scale) -> str:
    """Why no points were found, and what to photograph differently, in words."""
    centres = np.array([frame.camera.centre for frame in capture.frames])
    if np.ptp(centres, axis=0).max() < MIN_WALK * scale.distance:
        return (
            "the photographs were taken from nearly one place, which tells nothing of distances: poses are used as "
            "given; walk around what you photograph, a step to the side between photographs; "
            f"{_see('Turning on the spot')}"
        )
    return (
        "too little texture to refine poses or to tell how far things are: poses are used as given; photograph from "
        f"nearer, sharply, in more light, with something patterned in view; {_see('Blank walls')}"
    )


def _see(part: str) -> str:
    return f'see "{part}" in {PAGE}'


def _look(frame: Frame) -> tuple[bool, bool]:
    """Whether a photograph shows hardly any texture, and whether it is dark, in the pixels that are used."""
    reduction = max(1.0, max(frame.image.shape[:2]) / LOOKED_AT)
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    size = tuple(max(CELL, round(side / reduction)) for side in (grey.shape[1], grey.shape[0]))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    used = np.ones(small.shape, bool)
    if frame.usable is not None:
        used = cv2.resize(frame.usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    if not used.any():
        return False, False
    # Blurs carry what is masked across the mask's border.
    inside = cv2.erode(used.astype(np.uint8), np.ones((CELL + 1, CELL + 1), np.uint8)) > 0
    fine, coarse = (cv2.GaussianBlur(small.astype(np.float32), (0, 0), sigma) for sigma in (FINE, COARSE))
    contrast = _cells(fine - coarse).std(axis=1)
    textured = contrast[_cells(inside).all(axis=1)] >= MIN_CONTRAST
    blank = bool(len(textured)) and float(textured.mean()) < MIN_TEXTURED
    return blank, float(np.percentile(small[used], HIGHLIGHT)) < DARK


def _cells(values: np.ndarray) -> np.ndarray:
    """(C, CELL²) the whole cells of (H, W) values."""
    rows, columns = values.shape[0] // CELL, values.shape[1] // CELL
    whole = values[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL)
    return whole.swapaxes(1, 2).reshape(-1, CELL * CELL)
