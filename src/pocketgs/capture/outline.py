"""The image sizes of a capture, by which runs are planned."""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.capture.decoding.image_file import DECODING, DECODING_ALPHA
from pocketgs.capture.undistortion import MAP_PIXEL, MAX_KEPT

Size = tuple[int, int]
"""Width and height in pixels."""


@dataclass(frozen=True)
class Outline:
    """The image sizes that determine the memory and the time of a run.

    Attributes:
        training: sizes of the training photographs, as held in memory.
        held_out: sizes of the held-out photographs.
        stored_pixels: pixels of the largest photograph as stored.
        undone_pixels: pixels of the largest photograph once its lens is undone, before it is made smaller; 0 where no
            lens is.
        lenses: number of lenses that are undone, of each size of photograph.
        pixel_bytes: bytes per pixel: colour and, where frames have them, alpha, mask and depth.
        has_alpha: whether a photograph has alpha.
        read_again: whether features may be found in photographs that are read again at a larger size.
        copies: those of the undistorted copies that the geometry prior looks at, where photographs keep their lenses.
        kept_lenses: models of the lenses that photographs keep.
    """

    training: tuple[Size, ...]
    held_out: tuple[Size, ...]
    stored_pixels: int
    undone_pixels: int = 0
    lenses: int = 0
    pixel_bytes: int = 3
    has_alpha: bool = False
    read_again: bool = True
    copies: Outline | None = None
    kept_lenses: frozenset[str] = frozenset()

    @property
    def largest(self) -> Size:
        """Size of the photograph with the most pixels."""
        return max((*self.training, *self.held_out), key=lambda size: size[0] * size[1])

    @property
    def least_side(self) -> int:
        """The shortest side of any photograph."""
        return min(min(size) for size in (*self.training, *self.held_out))

    @property
    def pixels(self) -> int:
        """Pixels of the largest photograph."""
        width, height = self.largest
        return width * height

    @property
    def image_bytes(self) -> int:
        """Memory of all photographs with their alphas, masks and depths."""
        return self.pixel_bytes * sum(width * height for width, height in (*self.training, *self.held_out))

    @property
    def reading_bytes(self) -> int:
        """Memory while the largest photograph is read, with the maps by which lenses are undone."""
        undoing = self.pixel_bytes + MAP_PIXEL * min(self.lenses, MAX_KEPT)
        return (DECODING_ALPHA if self.has_alpha else DECODING) * self.stored_pixels + undoing * self.undone_pixels
