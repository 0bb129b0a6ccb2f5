"""Compositing rules of the CPU engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pocketgs.splat.cpu.contributions import inspect
from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.splat.cpu.rasterize_backward import rasterize_backward
from pocketgs.splat.cpu.sort import in_memory_order, sort_by_depth
from pocketgs.splat.cpu.sum import add_up, add_up_backward


@dataclass(frozen=True)
class Compositor:
    """A compositing rule.

    Attributes:
        name: of the rule.
        order: a kernel with the arguments of `sort_by_depth`.
        forward: a kernel with the arguments of `rasterize`.
        backward: a kernel with the arguments of `rasterize_backward`.
        inspect: a kernel with the arguments of `inspect`, or None for a rule without occlusion.
    """

    name: str
    order: Callable[..., tuple[np.ndarray, np.ndarray]]
    forward: Callable[..., None]
    backward: Callable[..., None]
    inspect: Callable[..., None] | None


OVER = Compositor("over", sort_by_depth, rasterize, rasterize_backward, inspect)
"""Front to back by depth: C = Σ c_i α_i T_i + T · background."""

SUM = Compositor("sum", in_memory_order, add_up, add_up_backward, None)
"""In any order: C = Σ c_i α_i + T · background, T = Π (1 - α_i)."""

COMPOSITORS = {rule.name: rule for rule in (OVER, SUM)}
