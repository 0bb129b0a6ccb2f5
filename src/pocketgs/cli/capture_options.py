"""Options for reading a capture, shared by several subcommands."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields
from pathlib import Path

from pocketgs.capture import Capture, ListedCapture, list_capture
from pocketgs.capture.hold_out import HOLD_OUT_EVERY
from pocketgs.capture.loading import LensHandling
from pocketgs.capture.masks import OutsideMasks, check_for_video, masks_folder
from pocketgs.capture.open import check_options
from pocketgs.capture.unposed import is_video
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError


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
    background: tuple[float, float, float] | None = None
    lens: LensHandling = "undistort"
    hold_out: int = HOLD_OUT_EVERY
    masks: str = "found"
    outside_masks: OutsideMasks = "unknown"

    def open(self, path: Path) -> Capture:
        """Read the capture at `path`, and print its reader's warnings to standard error."""
        capture = self.listed(path).load()
        warnings = [f"warning: {warning}" for warning in capture.warnings]
        Terminal(to_errors=True).say(*warnings, style="yellow")
        return capture

    def check(self) -> None:
        """Refuse options that are out of range, where a capture is read later.

        Raises:
            PocketGSError: one is.
        """
        check_options(self.downscale, self.max_size, self.background, self.lens, self.hold_out, self.outside_masks)

    def check_without_poses(self, path: Path, made: Path) -> None:
        """Refuse options that cannot be right for photographs or a video, before poses are sought for minutes.

        Args:
            path: of the photographs or the video.
            made: the capture that is made of them, which an earlier run may have left.

        Raises:
            PocketGSError: an option is out of range, images are chosen by folder, the named masks are not there, or a
                video's masks cannot be its own.
        """
        self.check()
        if self.images is not None:
            raise PocketGSError(
                f"{path}: has no poses, so that --images {self.images} has nothing to choose from: leave it out, and "
                "give the folder of the photographs themselves as the capture"
            )
        # A video's frames, and so their masks, belong to the capture that is made.
        masks = masks_folder(made if is_video(path) else path, self.masks)
        if is_video(path) and masks is not None:
            check_for_video(path, masks)

    def check_without_capture(self, expected: str, but: Collection[str] = ()) -> None:
        """Refuse options that would have no effect, because no capture is read.

        Args:
            expected: what gives one, for the message.
            but: names of options that have an effect in any case.

        Raises:
            PocketGSError: an option is given.
        """
        for field in fields(self):
            if field.name not in but and getattr(self, field.name) != field.default:
                flag = field.name.replace("_", "-")
                raise PocketGSError(f"--{flag} only applies to a capture: give {expected}, or leave the option out")

    def listed(self, path: Path) -> ListedCapture:
        """List the capture at `path` without decoding photographs."""
        return list_capture(
            path,
            images=self.images,
            downscale=self.downscale,
            max_size=self.max_size,
            background=self.background,
            lens=self.lens,
            hold_out_every=self.hold_out,
            masks=self.masks,
            outside_masks=self.outside_masks,
        )
