"""Relocation: opacity and scale of n coinciding copies that render like one Gaussian (3DGS-MCMC, equation 9)."""

from __future__ import annotations

import torch
from torch import Tensor

from pocketgs.torch.arrays import check_shape, check_tensors


@torch.no_grad()
def compute_relocation(opacities: Tensor, scales: Tensor, ratios: Tensor, binoms: Tensor) -> tuple[Tensor, Tensor]:
    """Opacities and scales of n coinciding copies of each Gaussian (Kheradmand et al. 2024, equation 9).

    Args:
        opacities: (N,) of the originals, in (0, 1).
        scales: (N, 3) standard deviations of the originals.
        ratios: (N,) number of copies n; clamped to 1 to n_max, in place.
        binoms: (n_max, n_max) binomial coefficients, row n, column k.

    Returns:
        Opacities (N,) and scales (N, 3) of each copy.

    Raises:
        PocketGSError: shapes disagree.
    """
    check_tensors(1, opacities=opacities, scales=scales, ratios=ratios, binoms=binoms)
    most = len(binoms)
    check_shape("opacities", opacities, (len(scales),))
    check_shape("scales", scales, (len(opacities), 3))
    check_shape("ratios", ratios, (len(opacities),))
    check_shape("binoms", binoms, (most, most))
    sharing = ratios.clamp_(min=1, max=most).long()
    whole = opacities.double()
    each = 1.0 - (1.0 - whole) ** (1.0 / sharing)
    # Coefficients of the inner sums of Σ_{i=1}^{n} Σ_{k=0}^{i-1} C(i-1, k) ... for every n.
    k = torch.arange(most, dtype=torch.float64)
    summed = binoms.double().cumsum(0) * (-1.0) ** k / (k + 1.0).sqrt()
    total = (summed[sharing - 1] * each[:, None] ** (k + 1.0)).sum(1)
    return each.to(opacities.dtype), ((whole / total)[:, None] * scales.double()).to(scales.dtype)
