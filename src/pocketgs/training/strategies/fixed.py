"""A strategy that keeps the number of Gaussians."""

from __future__ import annotations

from pocketgs.splat.engine import Engine
from pocketgs.training.strategies.strategy import Collected, StrategyContext, StrategyDefaults


class Fixed(StrategyDefaults):
    """Keeps the number of Gaussians."""

    name = "fixed"
    changes_rows = False

    def __init__(self, context: StrategyContext) -> None:
        """Ignores the context."""

    def collected(self, iteration: int) -> Collected:
        """Nothing."""
        return Collected()

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Does nothing."""
