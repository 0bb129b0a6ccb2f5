"""Options of a compression."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import get_args

from pocketgs.compression.pruning import Pruning
from pocketgs.errors import PocketGSError

QUALITY = 0.3
"""Default loss of quality, in dB."""


@dataclass(frozen=True)
class CompressionOptions:
    """Options of a compression.

    Attributes:
        size: Maximum megabytes (10^6 bytes) of the file; the best scene that fits is written.
        quality: dB by which the scene may be worse than the original on views that it was not trained on, with a margin
            where few of them were photographed; the smallest such file is written. By default 0.3; without a capture,
            the bound is the quality of a .spz, minus this if given.
        time_budget: Maximum seconds of the whole command.
        prune: Which Gaussians are removed first: those that contribute little to the training views (contribution),
            those that also look like their neighbours (distinct), or those that training with random Gaussians left out
            finds dispensable (masks: learned per Gaussian; unrelated to photograph masks).
        seed: Random seed.

    Raises:
        PocketGSError: an option is out of range, or both bounds are given.
    """

    size: float | None = None
    quality: float | None = None
    time_budget: float | None = None
    prune: Pruning = "contribution"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.size is not None and self.quality is not None:
            raise PocketGSError("compression: found both --size and --quality, expected one of them")
        checks = {
            "size": (self.size is None or 0 < self.size < math.inf, self.size, "megabytes above 0"),
            "quality": (self.quality is None or 0 <= self.quality < math.inf, self.quality, "dB, at least 0"),
            "time budget": (
                self.time_budget is None or 0 < self.time_budget < math.inf,
                self.time_budget,
                "seconds above 0",
            ),
            "prune": (self.prune in get_args(Pruning), self.prune, " or ".join(get_args(Pruning))),
            "seed": (self.seed >= 0, self.seed, "at least 0"),
        }
        for what, (sound, found, expected) in checks.items():
            if not sound:
                raise PocketGSError(f"{what}: found {found}, expected {expected}")
