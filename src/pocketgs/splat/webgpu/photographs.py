"""The capture's photographs on the GPU, packed as RGBA8: colour, and in the fourth byte whether the pixel counts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame


def packed(frame: Frame) -> np.ndarray:
    """(H·W,) uint32 of one photograph."""
    height, width = frame.image.shape[:2]
    pixels = np.full((height, width, 4), 255, np.uint8)
    pixels[..., :3] = frame.image
    if frame.mask is not None:
        pixels[..., 3] = np.where(frame.mask, 255, 0)
    return pixels.view(np.uint32).reshape(-1)


class Shelf:
    """Which photograph lies where in the buffer.

    As many as the budget allows have a place of their own and are uploaded once. The others share one place, and are
    written there before the step that needs them.

    Args:
        frames: the photographs.
        budget: pixels that the buffer may hold; at least the largest photograph is held whatever it says.
    """

    def __init__(self, frames: Sequence[Frame], budget: int) -> None:
        sizes = [frame.camera.width * frame.camera.height for frame in frames]
        shared = 0 if sum(sizes) <= budget else max(sizes)
        self.places, place = [], 0
        for size in sizes:
            fits = place + size + shared <= budget or not shared
            self.places.append(place if fits else None)
            place += size if fits else 0
        self.shared_place = place
        self.pixels = place + shared

    def place(self, view: int) -> int:
        """Where a photograph begins, in pixels."""
        own = self.places[view]
        return self.shared_place if own is None else own

    def is_resident(self, view: int) -> bool:
        """Whether the photograph has a place of its own."""
        return self.places[view] is not None
