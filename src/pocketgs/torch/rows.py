"""Rows of splats: one per Gaussian and camera, or, if packed, one per visible Gaussian."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor


class RowIds(NamedTuple):
    """The batch, the camera of that batch and the Gaussian of each row, (nnz,) int64."""

    batch_ids: Tensor
    camera_ids: Tensor
    gaussian_ids: Tensor


@dataclass(frozen=True)
class Rows:
    """The Gaussian and the camera of each row.

    Attributes:
        lead: shape of the batch dimensions.
        cameras: number of cameras per batch, C.
        count: number of Gaussians per batch, N.
        seen: (V,) int64, ascending, visible rows among all B C N.
        packed: whether there are rows only for those.
    """

    lead: tuple[int, ...]
    cameras: int
    count: int
    seen: Tensor
    packed: bool

    @property
    def images(self) -> int:
        """Number of images."""
        return math.prod(self.lead) * self.cameras

    @property
    def image_ids(self) -> Tensor | None:
        """(nnz,) image of each row; None if not packed."""
        if not self.packed:
            return None
        # One image, the usual case in training, needs no division.
        return torch.zeros_like(self.seen) if self.images == 1 else self.seen // self.count

    @cached_property
    def ids(self) -> RowIds | None:
        """Indices of each row; None if not packed."""
        images = self.image_ids
        if images is None:
            return None
        if self.images == 1:
            return RowIds(images, images, self.seen)
        return RowIds(images // self.cameras, images % self.cameras, self.seen % self.count)

    @cached_property
    def bounds(self) -> list[int]:
        """Start of each image's part of `seen`, then the end of the last one's."""
        return list(np.searchsorted(self.seen.numpy(), np.arange(self.images + 1) * self.count).tolist())

    @property
    def first_rows(self) -> list[int]:
        """Start of each image's rows, then the end of the last one's."""
        return self.bounds if self.packed else [image * self.count for image in range(self.images + 1)]

    def gaussians_seen_in(self, image: int) -> np.ndarray:
        """(V,) int64 Gaussians of the image's batch that are visible in it."""
        seen = self.seen.numpy()[self.bounds[image] : self.bounds[image + 1]]
        return seen - image * self.count if image else seen

    def of_gaussians(self, values: Tensor) -> Tensor:
        """Rows of (..., N, X) values that all cameras share."""
        if not self.packed:
            return values.unsqueeze(-3).expand(*self.lead, self.cameras, self.count, -1)
        places = self.seen
        if self.cameras > 1:
            ids = self.ids
            assert ids is not None
            places = ids.batch_ids * self.count + ids.gaussian_ids
        return values.reshape(-1, values.shape[-1]).index_select(0, places)

    def of_views(self, values: Tensor) -> Tensor:
        """Rows of (..., C, N, X) values."""
        return values.reshape(-1, values.shape[-1]).index_select(0, self.seen) if self.packed else values
