"""Rows of splats: one per Gaussian and camera, or, if packed, one per visible Gaussian."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Rows:
    """The Gaussian and the camera of each row.

    Attributes:
        lead: shape of the batch dimensions.
        cameras: number of cameras per batch, C.
        count: number of Gaussians per batch, N.
        radii: (..., C, N, 2), or (nnz, 2).
        batch_ids, camera_ids, gaussian_ids: (nnz,) int64, or None if not packed.
    """

    lead: tuple[int, ...]
    cameras: int
    count: int
    radii: Tensor
    batch_ids: Tensor | None = None
    camera_ids: Tensor | None = None
    gaussian_ids: Tensor | None = None

    @property
    def images(self) -> int:
        """Number of images."""
        return math.prod(self.lead) * self.cameras

    @property
    def image_ids(self) -> Tensor | None:
        """(nnz,) image of each row; None if not packed."""
        if self.batch_ids is None or self.camera_ids is None:
            return None
        return self.batch_ids * self.cameras + self.camera_ids

    @property
    def first_rows(self) -> list[int]:
        """Start of each image's rows, then the end of the last one's."""
        ids = self.image_ids
        if ids is None:
            return [image * self.count for image in range(self.images + 1)]
        return list(torch.searchsorted(ids, torch.arange(self.images + 1)).tolist())

    @property
    def seen(self) -> Tensor:
        """(I, N) bool, Gaussians that are visible in each image."""
        ids = self.image_ids
        if ids is None or self.gaussian_ids is None:
            # NumPy: waking PyTorch's threads for so little takes longer.
            return torch.from_numpy(self.radii.numpy()[..., 0].reshape(self.images, self.count) > 0)
        seen = torch.zeros(self.images * self.count, dtype=torch.bool)
        seen[ids * self.count + self.gaussian_ids] = True
        return seen.reshape(self.images, self.count)

    def of_gaussians(self, values: Tensor) -> Tensor:
        """Rows of (..., N, X) values that all cameras share."""
        if self.batch_ids is None or self.gaussian_ids is None:
            return values.unsqueeze(-3).expand(*self.lead, self.cameras, self.count, -1)
        places = self.batch_ids * self.count + self.gaussian_ids
        return values.reshape(-1, values.shape[-1]).index_select(0, places)

    def of_views(self, values: Tensor) -> Tensor:
        """Rows of (..., C, N, X) values."""
        ids = self.image_ids
        if ids is None or self.gaussian_ids is None:
            return values
        return values.reshape(-1, values.shape[-1]).index_select(0, ids * self.count + self.gaussian_ids)
