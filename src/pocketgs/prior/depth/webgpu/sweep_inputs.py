"""What the host writes to the GPU for a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.gpu.sizes import Symbols
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.source_views import mapping
from pocketgs.prior.depth.sweep import SweepSettings, step_of
from pocketgs.prior.depth.webgpu.layout import MATCHED, USABLE


@dataclass(frozen=True, eq=False)
class SweepInputs:
    """One sweep for the GPU.

    Attributes:
        given: the numbers that `describe_sweep` names, but for `bands`.
        buffers: contents by name.
        fields: of the uniform buffer, but for those that follow from the numbers.
    """

    given: dict[str, int]
    buffers: Mapping[str, np.ndarray]
    fields: Mapping[str, ArrayLike]

    @staticmethod
    def of(keyframe: Frame, source_views: Sequence[Frame], search: DepthRange, settings: SweepSettings) -> SweepInputs:
        """The inputs of a keyframe's sweep; see `pocketgs.prior.depth.stereo.Stereo.sweep`."""
        photographs = packed([keyframe, *source_views])
        inverse_depths = search.inverse_depths
        images, image_height, image_width = photographs.shape
        given = {
            "width": keyframe.camera.width,
            "height": keyframe.camera.height,
            "image_width": image_width,
            "image_height": image_height,
            "images": images,
            "hypotheses": len(inverse_depths),
            "paths": settings.paths,
        }
        fields = {
            "small_step": settings.small_step,
            "large_step": settings.large_step,
            "is_bounded": int(np.isfinite(search.farthest)),
            "has_masks": int(any(frame.mask is not None for frame in source_views)),
            "step": step_of(inverse_depths),
        }
        records = source_records(keyframe.camera, [frame.camera for frame in source_views])
        buffers = {"photographs": photographs, "sources": records, "inverse_depths": inverse_depths}
        return SweepInputs(given, buffers, fields)

    def uniform(self, symbols: Symbols) -> dict[str, ArrayLike]:
        """All fields of the uniform buffer.

        Args:
            symbols: from `Description.symbols`.
        """
        same = ("width", "height", "image_width", "image_height", "hypotheses", "lanes", "bands", "band_rows", "paths")
        return {**self.fields, **{name: symbols[name] for name in same}, "sources": symbols["images"] - 1}


def packed(frames: Sequence[Frame]) -> np.ndarray:
    """(F, h, w) uint32: red, green and blue of each pixel, and whether it counts, padded to one size."""
    height, width = np.max([frame.image.shape[:2] for frame in frames], axis=0)
    pixels = np.zeros((len(frames), height, width), np.uint32)
    for place, frame in zip(pixels, frames, strict=True):
        rows, columns = frame.image.shape[:2]
        place[:rows, :columns] = frame.image.astype(np.uint32) @ np.array([1, 1 << 8, 1 << 16], np.uint32)
        for bit, counts in ((MATCHED, frame.mask), (USABLE, frame.usable)):
            place[:rows, :columns] |= np.uint32(bit) if counts is None else np.uint32(bit) * counts
    return pixels


def source_records(view: Camera, sources: Sequence[Camera]) -> np.ndarray:
    """(R, 4, 4) float32: the rows of each source view's turn with its shift beside them, then its width and height."""
    records = np.zeros((len(sources), 4, 4), np.float32)
    for record, camera in zip(records, sources, strict=True):
        record[:3, :3], record[:3, 3] = mapping(view, camera)
        record[3, :2] = camera.width, camera.height
    return records
