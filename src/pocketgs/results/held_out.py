"""Comparing a scene with the photographs that were held out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.files.plain_names import plain_names
from pocketgs.metrics.evaluation import Evaluation, Pair, evaluate
from pocketgs.results.folder import write_side_by_side
from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.engine import Renderer
from pocketgs.splat.rendering import render_frame


def check_comparable(held_out: Sequence[Frame]) -> None:
    """Check before the work starts that every held-out view can be compared with its photograph.

    Raises:
        PocketGSError: one of them cannot.
    """
    border = SSIM_WINDOW // 2
    for frame in held_out:
        width, height = frame.camera.width, frame.camera.height
        if min(width, height) < SSIM_WINDOW:
            expected = f"expected at least {SSIM_WINDOW} pixels a side, or --hold-out 0"
            raise PocketGSError(f"{frame.name}: a held-out view of {width}x{height} pixels, {expected}")
        if frame.mask is not None and not frame.mask[border:-border, border:-border].any():
            expected = f"expected unmasked pixels {border} or more inside the image, or --hold-out 0"
            raise PocketGSError(f"{frame.name}: the mask of a held-out view leaves nothing, {expected}")


def evaluate_held_out(renderer: Renderer, capture: Capture, pictures: Path | None = None) -> Evaluation | None:
    """Compare a scene with the held-out photographs; None if there are none.

    Args:
        renderer: holds the scene.
        capture: with the held-out frames and the background.
        pictures: an existing folder for side-by-side images, or None for no images.
    """
    if not capture.held_out:
        return None

    def pairs() -> Iterator[Pair]:
        names = plain_names(frame.name for frame in capture.held_out)
        for frame, name in zip(capture.held_out, names, strict=True):
            rendered = render_frame(renderer, frame, capture.background)
            if pictures:
                write_side_by_side(pictures, name, frame.image, rendered)
            photo = (frame.image / np.float32(255.0)).astype(np.float32)
            yield Pair(frame.name, rendered, photo, frame.mask, frame.visible)

    return evaluate(pairs())
