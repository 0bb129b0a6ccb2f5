"""How to read a capture: the options that several subcommands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pocketgs.capture import Capture, ListedCapture, list_capture
from pocketgs.cli.terminal import Terminal


@dataclass(frozen=True)
class CaptureOptions:
    """How to read the capture.

    Attributes:
        images: Folder inside the capture to take the images from, for example images_8.
        downscale: Shrink images by this factor, averaging areas. By default not at all, or, in a run whose budgets
            are too small for that, by the least whole factor that fits.
        max_size: Shrink images further so that their longer side has at most this many pixels.
        background: Red, green and blue from 0 to 1 behind images with alpha. By default the format's own.
        undistort: Undo lens distortion and crop to what the lens saw; --no-undistort takes images as they are.
        hold_out: Keep every so many frames for evaluation, unless the data set states its own; 0 for none.
        masks: Folder with masks, white where pixels are to be used. By default those that the capture states or has in
            a folder masks or mask; "none" takes none.
    """

    images: str | None = None
    downscale: float | None = None
    max_size: int | None = None
    background: tuple[float, float, float] | None = None
    undistort: bool = True
    hold_out: int = 8
    masks: str = "found"

    def open(self, path: Path) -> Capture:
        """Read the capture at `path`, and print on standard error what its reader warns of."""
        capture = self.listed(path).load()
        warnings = [f"warning: {warning}" for warning in capture.warnings]
        Terminal(to_errors=True).say(*warnings, style="yellow")
        return capture

    def listed(self, path: Path) -> ListedCapture:
        """What is known of the capture at `path` before its photographs are decoded."""
        return list_capture(
            path,
            images=self.images,
            downscale=self.downscale,
            max_size=self.max_size,
            background=self.background,
            undistort=self.undistort,
            hold_out_every=self.hold_out,
            masks=self.masks,
        )
