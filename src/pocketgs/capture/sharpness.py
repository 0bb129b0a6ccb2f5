"""Image sharpness, and the selection of the sharpest frame in each window of a sequence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import Context, copy_context

import cv2
import numpy as np

from pocketgs.capture.decoding.image_file import read_grey
from pocketgs.errors import PocketGSError
from pocketgs.files.opening import CaptureFile

REDUCED_SIDE = 640
"""Longer side at which sharpness is measured: small enough to average out sensor noise, large enough to show motion
blur."""

MAX_FRAMES = 150
"""Maximum number of frames from a recording: it has up to 60 per second, and more views of a place add time, not
detail."""


def sharpness(grey: np.ndarray) -> float:
    """Mean absolute difference of neighbouring pixels of the reduced image; only comparable between similar views.

    Args:
        grey: (H, W) uint8.
    """
    height, width = grey.shape
    reduction = max(1.0, max(height, width) / REDUCED_SIDE)
    size = (max(2, round(width / reduction)), max(2, round(height / reduction)))
    reduced = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.int16)
    return float(np.abs(np.diff(reduced, axis=0)).mean() + np.abs(np.diff(reduced, axis=1)).mean())


def sharpest_in_windows(values: Sequence[float], count: int) -> list[int]:
    """Index of the largest value in each of `count` equal windows, ascending; all indices if there are no more.

    Raises:
        PocketGSError: `count` is below 1.
    """
    if count < 1:
        raise PocketGSError(f"{count} frames to choose, expected at least 1")
    windows = np.array_split(np.asarray(values, dtype=np.float64), min(count, max(1, len(values))))
    starts = np.cumsum([0, *map(len, windows[:-1])])
    return [int(start + window.argmax()) for start, window in zip(starts, windows, strict=True) if window.size]


def sharpest_photographs(files: Mapping[int, CaptureFile], most: int = MAX_FRAMES) -> list[int]:
    """Numbers of a recording's photographs to use, ascending: all, or the sharpest of each of `most` windows.

    Raises:
        PocketGSError: there are more than `most`, and one cannot be decoded.
    """
    if len(files) <= most:
        return sorted(files)
    numbers = sorted(files)

    def measured(number: int, context: Context) -> float:
        return context.run(lambda: sharpness(read_grey(files[number], REDUCED_SIDE)))

    with ThreadPoolExecutor() as pool:
        # The folder that files must lie in is part of the context.
        values = list(pool.map(measured, numbers, [copy_context() for _ in numbers]))
    return [numbers[place] for place in sharpest_in_windows(values, most)]


def thinning_warning(where: str, chosen: int, available: int) -> tuple[str, ...]:
    """A warning that says how many frames of a recording are used, or none if all are."""
    if chosen == available:
        return ()
    return (f"{where}: {chosen} of {available} frames are used, the sharpest of each part of the recording",)
