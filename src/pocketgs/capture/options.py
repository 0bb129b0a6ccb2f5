"""Options for reading a capture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import get_args

from pocketgs.capture.hold_out import HOLD_OUT_EVERY
from pocketgs.capture.loading import LensHandling
from pocketgs.capture.masks import FOUND, OutsideMasks
from pocketgs.errors import PocketGSError
from pocketgs.scene.background import Background, checked_background


@dataclass(frozen=True)
class CaptureOptions:
    """Options for reading a capture.

    Attributes:
        images: Folder inside the capture to take the images from, for example images_8.
        downscale: Reduce images by this factor, averaging areas. By default not at all, or, if a run's budgets are too
            small for that, by the smallest integer factor that fits.
        max_size: Reduce images further so that their longer side has at most this many pixels.
        background: Red, green and blue from 0 to 1 behind the scene and behind images with alpha. By default that of
            the given scene's run, the plain colour that photographs without alpha show an object before, or the
            format's own.
        lens: Undo lens distortion and crop to what the lens saw (undistort), render through the lens (direct):
            photographs are then neither resampled nor cropped, fisheyes up to 180 degrees; or take images for those of
            pinhole cameras (ignore).
        hold_out: Hold out every n-th frame for evaluation, unless the data set has its own split; 0 for none. Of fewer
            than four frames none is held out, unless n is at most their number.
        masks: Folder with masks, white for pixels to use. By default those that the capture states or has in a folder
            masks or mask; "none" uses no masks.
        outside_masks: What lies outside the masks is unknown, and can become anything; or empty: the masked object is
            cut out.
    """

    images: str | None = None
    downscale: float | None = None
    max_size: int | None = None
    background: Background | None = None
    lens: LensHandling = "undistort"
    hold_out: int = HOLD_OUT_EVERY
    masks: str = FOUND
    outside_masks: OutsideMasks = "unknown"

    def __post_init__(self) -> None:
        if self.downscale is not None and (not math.isfinite(self.downscale) or self.downscale < 1):
            raise PocketGSError(f"downscale {self.downscale}, expected a factor of at least 1")
        if self.max_size is not None and self.max_size < 1:
            raise PocketGSError(f"max_size {self.max_size}, expected at least 1 pixel")
        if self.background is not None:
            checked_background(self.background)
        if self.lens not in get_args(LensHandling):
            raise PocketGSError(f"lens {self.lens!r}, expected {', '.join(get_args(LensHandling))}")
        if self.hold_out < 0 or self.hold_out == 1:
            raise PocketGSError(f"held out every {self.hold_out} frames, expected at least 2, or 0 for none")
        if self.outside_masks not in get_args(OutsideMasks):
            raise PocketGSError(f"outside_masks {self.outside_masks!r}, expected {', '.join(get_args(OutsideMasks))}")
