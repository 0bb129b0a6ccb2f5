"""Colours of splats: as given, or from spherical harmonics in the direction of each camera."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.torch.arrays import check_shape, whole_numbers
from pocketgs.torch.harmonics import ViewColours, coefficients_used
from pocketgs.torch.rows import Rows


def drawn_colours(rows: Rows, means: Tensor, colors: Tensor, viewmats: Tensor, sh_degree: int | None) -> Tensor:
    """Each row's channels.

    Args:
        rows: the rows.
        means: (..., N, 3).
        colors: see `rasterization`.
        viewmats: (..., C, 4, 4).
        sh_degree: maximum degree of the harmonics to use, or None if `colors` are final colours.

    Raises:
        PocketGSError: colours have another shape or no channels, or there is no such degree.
    """
    shared, own = (*rows.lead, rows.count), (*rows.lead, rows.cameras, rows.count)
    tail = (colors.shape[-1],) if sh_degree is None else (-1, 3)
    check_shape("colors", colors, (*shared, *tail), (*own, *tail))
    are_shared = colors.ndim == len(shared) + len(tail)
    if sh_degree is None:
        check_channels(colors.shape[-1])
        return rows.of_gaussians(colors) if are_shared else rows.of_views(colors)
    (sh_degree,) = whole_numbers(0, sh_degree=sh_degree)
    used = coefficients_used(sh_degree, colors.shape[-2])
    batches = math.prod(rows.lead)
    places = means.reshape(batches, rows.count, 3)
    tables = batches if are_shared else rows.images
    coefficients = colors.reshape(tables, rows.count, *colors.shape[-2:])
    # Degree 0 does not depend on the direction.
    centres = torch.linalg.inv(viewmats)[..., :3, 3].reshape(-1, 3) if sh_degree else None
    found = []
    for image in range(rows.images):
        batch = image // rows.cameras
        directions = places[batch].detach() if centres is None else places[batch] - centres[image]
        table = coefficients[batch if are_shared else image]
        found.append(ViewColours.apply(directions, table, used, rows.gaussians_seen_in(image), rows.packed))
    values = found[0] if len(found) == 1 else torch.cat([colors.new_empty(0, 3), *found])
    return values if rows.packed else values.reshape(*own, 3)


def check_channels(channels: int) -> None:
    """Check that colours have channels.

    Raises:
        PocketGSError: they have none.
    """
    if channels == 0:
        raise PocketGSError("colors: found no channels, expected at least one")
