"""Undistorting, cropping and reducing a frame: its image, and with it its camera, alpha, mask and depth."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.undistortion import undistortion
from pocketgs.errors import PocketGSError
from pocketgs.geometry.lens import Lens


def undistorted(frame: Frame, lens: Lens) -> Frame:
    """Undistort a frame to a pinhole camera, cropped to pixels that the lens saw.

    Raises:
        PocketGSError: as `undistortion`.
    """
    undoing = undistortion(frame.camera, lens)
    # Bilinear, as in OpenCV's undistort and COLMAP's image_undistorter, so that figures are comparable: sharper
    # interpolation keeps more fine texture to reproduce and costs about 1 dB of PSNR.
    smooth = cv2.INTER_LINEAR
    return replace(
        frame,
        camera=undoing.view(frame.camera),
        image=undoing.apply(frame.image, smooth),
        alpha=None if frame.alpha is None else undoing.apply(frame.alpha, smooth),
        mask=None if frame.mask is None else undoing.apply(frame.mask.astype(np.uint8), cv2.INTER_NEAREST) > 0,
        depth=None if frame.depth is None else undoing.apply(frame.depth, cv2.INTER_NEAREST),
    )


def downscaled(frame: Frame, downscale: float, max_size: int | None) -> Frame:
    """Reduce a frame by `downscale`, rounding down, and to at most `max_size` pixels a side.

    Colours and alpha are averaged over areas, masks take the majority of the area, and depths the nearest pixel.

    Raises:
        PocketGSError: no pixel would be left.
    """
    if float(downscale).is_integer():
        frame = _cropped_to_multiple(frame, int(downscale))
    camera = frame.camera
    width, height = size_after(camera.width, camera.height, downscale, max_size)
    if (width, height) == (camera.width, camera.height):
        return frame
    return replace(
        frame,
        camera=camera.resized(width, height),
        image=_averaged(frame.image, width, height),
        alpha=None if frame.alpha is None else _averaged(frame.alpha, width, height),
        mask=None if frame.mask is None else _averaged(frame.mask.astype(np.uint8) * 255, width, height) > 127,
        depth=None if frame.depth is None else nearest(frame.depth, width, height),
    )


def size_after(width: int, height: int, downscale: float, max_size: int | None) -> tuple[int, int]:
    """Width and height after reducing an image by `downscale`, rounding down, and to at most `max_size` pixels a side.

    Raises:
        PocketGSError: no pixel would be left.
    """
    small_width, small_height = int(width / downscale), int(height / downscale)
    longer = max(small_width, small_height)
    if max_size is not None and longer > max_size:
        small_width, small_height = (max(1, round(side * max_size / longer)) for side in (small_width, small_height))
    if min(small_width, small_height) < 1:
        raise PocketGSError(f"{width}x{height} pixels cannot be downscaled by {downscale:g}")
    return small_width, small_height


def _cropped_to_multiple(frame: Frame, factor: int) -> Frame:
    """Drop the last rows and columns that do not fill a block of `factor` pixels, so that averaging is exact."""
    width = frame.camera.width - frame.camera.width % factor
    height = frame.camera.height - frame.camera.height % factor
    if min(width, height) < 1 or (width, height) == (frame.camera.width, frame.camera.height):
        return frame
    return cropped(frame, 0, 0, width, height)


def cropped(frame: Frame, left: int, top: int, width: int, height: int) -> Frame:
    """Crop a frame to the rectangle whose top left pixel is (left, top).

    Raises:
        PocketGSError: the rectangle is empty.
    """
    rows, columns = slice(top, top + height), slice(left, left + width)
    return replace(
        frame,
        camera=frame.camera.cropped(left, top, width, height),
        image=frame.image[rows, columns],
        alpha=None if frame.alpha is None else frame.alpha[rows, columns],
        mask=None if frame.mask is None else frame.mask[rows, columns],
        depth=None if frame.depth is None else frame.depth[rows, columns],
    )


def _averaged(array: np.ndarray, width: int, height: int) -> np.ndarray:
    return cv2.resize(array, (width, height), interpolation=cv2.INTER_AREA)


def nearest(array: np.ndarray, width: int, height: int) -> np.ndarray:
    """Resize (H, W) or (H, W, C) pixels with nearest-neighbour sampling at pixel centres."""
    rows = ((np.arange(height) + 0.5) * (array.shape[0] / height)).astype(int)
    columns = ((np.arange(width) + 0.5) * (array.shape[1] / width)).astype(int)
    return array[rows[:, None], columns]
