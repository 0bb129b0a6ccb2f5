"""The number of Gaussians stays what it was at the start."""

from __future__ import annotations

from pocketgs.splat.engine import Engine
from pocketgs.training.strategies.strategy import Collected, Quiet, Situation


class Fixed(Quiet):
    """Does nothing."""

    name = "fixed"

    def __init__(self, situation: Situation) -> None:
        """Nothing of the situation matters."""

    def collected(self, iteration: int) -> Collected:
        """Nothing."""
        return Collected()

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Nothing."""
