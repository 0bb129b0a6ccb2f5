"""The capture's photographs on the GPU, packed as RGBA8: colour, and in the fourth byte whether the pixel counts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame

PIXEL_BYTES = 4


def packed(frame: Frame) -> np.ndarray:
    """(H·W,) uint32 of one photograph."""
    height, width = frame.image.shape[:2]
    pixels = np.full((height, width, 4), 255, np.uint8)
    pixels[..., :3] = frame.image
    if frame.mask is not None:
        pixels[..., 3] = np.where(frame.mask, 255, 0)
    return pixels.view(np.uint32).reshape(-1)


class Shelf:
    """The photographs' places in the buffer.

    As many as there is room for have a place of their own and are uploaded once. The others share one place, and are
    written there before the step that needs them.

    Args:
        sizes: pixels of every photograph.
        room: pixels that the buffer may hold, at least as many as the largest photograph has.
    """

    def __init__(self, sizes: Sequence[int], room: int) -> None:
        shared = 0 if sum(sizes) <= room else max(sizes)
        self._places: list[int | None] = []
        place = 0
        for size in sizes:
            fits = place + size + shared <= room
            self._places.append(place if fits else None)
            place += size if fits else 0
        self._shared_place = place
        self.pixels = place + shared

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Shelf) and (self._places, self.pixels) == (other._places, other.pixels)

    def place(self, view: int) -> int:
        """Offset of a photograph, in pixels."""
        own = self._places[view]
        return self._shared_place if own is None else own

    def is_resident(self, view: int) -> bool:
        """Whether the photograph has a place of its own."""
        return self._places[view] is not None
