"""How splats that cover the same pixel come together; the twin of `pocketgs.splat.cpu.compositor`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.splat.reference.project import ProjectionGradient
from pocketgs.splat.reference.rasterize import Raster, rasterize, rasterize_backward


@dataclass(frozen=True)
class Compositor:
    """A rule of compositing.

    Attributes:
        name: of the rule.
        forward: with the arguments of `rasterize`.
        replay: with the arguments of `rasterize_backward`.
    """

    name: str
    forward: Callable[..., Raster]
    replay: Callable[..., ProjectionGradient]


OVER = Compositor("over", rasterize, rasterize_backward)
"""Front to back in order of depth: C = Σ c_i α_i T_i + T · background."""
