"""Compositing rules of the reference; see `pocketgs.splat.cpu.compositor`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pocketgs.splat.backend import Contributions
from pocketgs.splat.reference.project import ProjectionGradient
from pocketgs.splat.reference.rasterize import Raster, contributions, rasterize, rasterize_backward
from pocketgs.splat.reference.sum import add_up, add_up_backward


@dataclass(frozen=True)
class Compositor:
    """A compositing rule.

    Attributes:
        name: of the rule.
        forward: with the arguments of `rasterize`.
        backward: with the arguments of `rasterize_backward`.
        inspect: with the arguments of `contributions`, or None for a rule without occlusion.
    """

    name: str
    forward: Callable[..., Raster]
    backward: Callable[..., ProjectionGradient]
    inspect: Callable[..., tuple[Contributions, np.ndarray]] | None


OVER = Compositor("over", rasterize, rasterize_backward, contributions)
"""Front to back in order of depth: C = Σ c_i α_i T_i + T · background."""

SUM = Compositor("sum", add_up, add_up_backward, None)
"""In any order: C = Σ c_i α_i + T · background, T = Π (1 - α_i)."""

COMPOSITORS = {rule.name: rule for rule in (OVER, SUM)}
