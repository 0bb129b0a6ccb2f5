"""What Gaussians in one place must be to look as the one did (Kheradmand et al. 2024, equation 9)."""

from __future__ import annotations

import torch
from torch import Tensor

from pocketgs.torch.arrays import check_shape


@torch.no_grad()
def compute_relocation(opacities: Tensor, scales: Tensor, ratios: Tensor, binoms: Tensor) -> tuple[Tensor, Tensor]:
    """Opacities and scales of n Gaussians in the place of one.

    Args:
        opacities: (N,) of the one, in (0, 1).
        scales: (N, 3) standard deviations of the one.
        ratios: (N,) how many there are to be; cut to 1 to n_max, in place.
        binoms: (n_max, n_max) binomial coefficients, row n, column k.

    Returns:
        Opacities (N,) and scales (N, 3) of each.

    Raises:
        PocketGSError: shapes disagree.
    """
    most = len(binoms)
    check_shape("opacities", opacities, (len(scales),))
    check_shape("scales", scales, (len(opacities), 3))
    check_shape("ratios", ratios, (len(opacities),))
    check_shape("binoms", binoms, (most, most))
    sharing = ratios.clamp_(min=1, max=most).long()
    whole = opacities.double()
    each = 1.0 - (1.0 - whole) ** (1.0 / sharing)
    # Σ_{i=1}^{n} Σ_{k=0}^{i-1} C(i-1, k) ... : the inner sums' coefficients for every n, once.
    k = torch.arange(most, dtype=torch.float64)
    summed = binoms.double().cumsum(0) * (-1.0) ** k / (k + 1.0).sqrt()
    total = (summed[sharing - 1] * each[:, None] ** (k + 1.0)).sum(1)
    return each.to(opacities.dtype), ((whole / total)[:, None] * scales.double()).to(scales.dtype)
