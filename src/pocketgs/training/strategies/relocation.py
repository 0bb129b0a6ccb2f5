"""Relocation: opacity and scale of n coinciding copies that render like one Gaussian (3DGS-MCMC, equation 9)."""

from __future__ import annotations

import numpy as np
from scipy.special import comb

MAX_RATIO = 51
"""Maximum number of copies in the formula: its terms alternate in sign and grow. Larger ratios are clamped."""


def compute_relocation(opacities: np.ndarray, ratios: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Opacity of each of n copies of a Gaussian, and the factor on its scales (Kheradmand et al. 2024, equation 9).

    At their centres, the composited copies have the opacity of the original: 1 - (1 - o')^n = o. The factor on their
    standard deviations, o / Σ_{i=1}^{n} Σ_{k=0}^{i-1} C(i-1, k) (-1)^k o'^{k+1} / √(k+1), preserves the total opacity
    along a line.

    Args:
        opacities: (R,) of the original, in (0, 1).
        ratios: (R,) number of copies n, at least 1.

    Returns:
        Both (R,) float64.
    """
    ratios = np.minimum(ratios, MAX_RATIO)
    each = 1.0 - (1.0 - opacities.astype(np.float64)) ** (1.0 / ratios)
    total = np.zeros(len(each))
    for i in range(1, int(ratios.max(initial=0)) + 1):
        k = np.arange(i)
        terms = comb(i - 1, k) * (-1.0) ** k / np.sqrt(k + 1) * each[:, None] ** (k + 1)
        total += np.where(ratios >= i, terms.sum(axis=1), 0.0)
    return each, opacities / total
