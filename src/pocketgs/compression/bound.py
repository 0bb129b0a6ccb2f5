"""The bound that a compressed scene must meet: a maximum size, or a minimum quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pocketgs.compression.candidates import Candidate
from pocketgs.errors import PocketGSError


class Bound(Protocol):
    """What a candidate must meet, and which one is best."""

    def admits(self, candidate: Candidate) -> bool:
        """Whether a candidate meets the bound."""

    def best(self, candidates: Sequence[Candidate]) -> Candidate:
        """The best of the candidates, at least one.

        Raises:
            PocketGSError: none can be used.
        """


@dataclass(frozen=True)
class SizeBound:
    """The best quality in at most so many megabytes (10^6 bytes)."""

    megabytes: float

    def admits(self, candidate: Candidate) -> bool:
        """Whether the file is small enough."""
        return candidate.megabytes <= self.megabytes

    def best(self, candidates: Sequence[Candidate]) -> Candidate:
        """The one of highest quality that is small enough.

        Raises:
            PocketGSError: none is.
        """
        admitted = list(filter(self.admits, candidates))
        if not admitted:
            smallest = min(candidate.megabytes for candidate in candidates)
            # With another bound, other Gaussians are pruned, so that the smallest file has another size.
            expected = f"expected --size of at least some {1.1 * smallest:.3g}"
            raise PocketGSError(f"compression: the smallest file has {smallest:.6f} MB, {expected}")
        return max(admitted, key=lambda candidate: candidate.psnr)


@dataclass(frozen=True)
class QualityBound:
    """The smallest file of at least so many dB of PSNR."""

    psnr: float

    def admits(self, candidate: Candidate) -> bool:
        """Whether the quality suffices."""
        return candidate.psnr >= self.psnr

    def best(self, candidates: Sequence[Candidate]) -> Candidate:
        """The smallest of sufficient quality, or else the one of highest quality."""
        admitted = list(filter(self.admits, candidates))
        if not admitted:
            return max(candidates, key=lambda candidate: candidate.psnr)
        return min(admitted, key=lambda candidate: candidate.megabytes)
