"""Compositing rules. A rule is one object, and tiles do not depend on which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.splat.cpu.contributions import inspect
from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.splat.cpu.rasterize_backward import rasterize_backward


@dataclass(frozen=True)
class Compositor:
    """A compositing rule.

    Attributes:
        name: of the rule.
        forward: a kernel with the arguments of `rasterize`.
        replay: a kernel with the arguments of `rasterize_backward`.
        inspect: a kernel with the arguments of `inspect`.
    """

    name: str
    forward: Callable[..., None]
    replay: Callable[..., None]
    inspect: Callable[..., None]


OVER = Compositor("over", rasterize, rasterize_backward, inspect)
"""Front to back by depth: C = Σ c_i α_i T_i + T · background."""
