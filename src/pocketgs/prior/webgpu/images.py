"""The photographs of a sweep as the shaders read them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.source_views import mapping

MATCHED, USABLE = 1, 2
"""Bits of a pixel's highest byte: it is not masked; it is neither masked nor transparent. As in
`common/photographs.wgsl`."""


def packed(frames: Sequence[Frame]) -> np.ndarray:
    """(F, h, w) uint32: red, green, blue and the bits of each pixel, padded to one size."""
    height, width = np.max([frame.image.shape[:2] for frame in frames], axis=0)
    pixels = np.zeros((len(frames), height, width, 4), np.uint8)
    for place, frame in zip(pixels, frames, strict=True):
        rows, columns = frame.image.shape[:2]
        place[:rows, :columns, :3] = frame.image
        place[:rows, :columns, 3] = _bits(frame)
    return pixels.view(np.uint32)[..., 0]


def _bits(frame: Frame) -> np.ndarray | int:
    bits: np.ndarray | int = MATCHED if frame.mask is None else MATCHED * frame.mask.astype(np.uint8)
    usable = frame.usable
    return bits | (USABLE if usable is None else USABLE * usable.astype(np.uint8))


def source_records(view: Camera, sources: Sequence[Camera]) -> np.ndarray:
    """(R, 4, 4) float32: the rows of each source view's turn with its shift beside them, then its width and height."""
    records = np.zeros((len(sources), 4, 4), np.float32)
    for record, camera in zip(records, sources, strict=True):
        record[:3, :3], record[:3, 3] = mapping(view, camera)
        record[3, :2] = camera.width, camera.height
    return records
