"""What n Gaussians in one place must be to look as the one did (Kheradmand et al. 2024, equation 9)."""

from __future__ import annotations

import numpy as np
from scipy.special import comb

MAX_SHARING = 51
"""Terms of alternating sign grow with the number of Gaussians; more than so many count as so many."""


def shared(opacities: np.ndarray, sharing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Opacity of each of n Gaussians in one place, and by what factor they are smaller than the one.

    Composited, their centres hide as much as the one's did, 1 - (1 - o')^n = o. Their standard deviations shrink by
    o / Σ_{i=1}^{n} Σ_{k=0}^{i-1} C(i-1, k) (-1)^k o'^{k+1} / √(k+1), so that a line hides as much in all.

    Args:
        opacities: (R,) of the one, in (0, 1).
        sharing: (R,) how many there are to be, 1 or more.

    Returns:
        Both (R,) float64.
    """
    sharing = np.minimum(sharing, MAX_SHARING)
    each = 1.0 - (1.0 - opacities.astype(np.float64)) ** (1.0 / sharing)
    total = np.zeros(len(each))
    for i in range(1, int(sharing.max(initial=0)) + 1):
        k = np.arange(i)
        terms = comb(i - 1, k) * (-1.0) ** k / np.sqrt(k + 1) * each[:, None] ** (k + 1)
        total += np.where(sharing >= i, terms.sum(axis=1), 0.0)
    return each, opacities / total
