"""A strategy that keeps the number of Gaussians."""

from __future__ import annotations

from pocketgs.splat.engine import Engine
from pocketgs.training.strategies.strategy import Collected, Quiet, Situation


class Fixed(Quiet):
    """Keeps the number of Gaussians."""

    name = "fixed"
    changes_rows = False

    def __init__(self, situation: Situation) -> None:
        """Ignores the situation."""

    def collected(self, iteration: int) -> Collected:
        """Nothing."""
        return Collected()

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Does nothing."""
