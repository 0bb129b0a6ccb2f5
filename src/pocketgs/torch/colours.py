"""The colours that splats are drawn with: as they are given, or from harmonics in the direction of each camera."""

from __future__ import annotations

import torch
from torch import Tensor

from pocketgs.torch.arrays import check_shape
from pocketgs.torch.harmonics import spherical_harmonics
from pocketgs.torch.rows import Rows


def drawn_colours(rows: Rows, means: Tensor, colors: Tensor, viewmats: Tensor, sh_degree: int | None) -> Tensor:
    """Each row's channels.

    Args:
        rows: which there are.
        means: (..., N, 3).
        colors: as `rasterization` takes them.
        viewmats: (..., C, 4, 4).
        sh_degree: of the harmonics that count, or None for colours as they are.

    Raises:
        PocketGSError: colours have another shape.
    """
    shared, own = (*rows.lead, rows.count), (*rows.lead, rows.cameras, rows.count)
    tail = (colors.shape[-1],) if sh_degree is None else (-1, 3)
    check_shape("colors", colors, (*shared, *tail), (*own, *tail))
    are_shared = colors.ndim == len(shared) + len(tail)
    if sh_degree is None:
        return rows.of_gaussians(colors) if are_shared else rows.of_views(colors)
    seen = rows.seen
    places = means.reshape(-1, rows.count, 3)
    coefficients = colors.reshape(-1, rows.count, *colors.shape[-2:])
    # What does not depend on the direction need not know it.
    centres = torch.linalg.inv(viewmats)[..., :3, 3].reshape(-1, 3) if sh_degree else None
    found = []
    for image in range(rows.images):
        batch = image // rows.cameras
        directions = places[batch].detach() if centres is None else places[batch] - centres[image]
        table = coefficients[batch if are_shared else image]
        found.append(spherical_harmonics(sh_degree, directions, table, seen[image]))
    values = found[0] if len(found) == 1 else torch.stack(found)
    return rows.of_views((values + 0.5).clamp(min=0.0).reshape(*own, 3))
