"""The conditions that runs must share to be compared."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from pocketgs.benchmark.machine import describe_machine
from pocketgs.benchmark.sources import digest_of_sources


@dataclass(frozen=True)
class Conditions:
    """The conditions that runs must share to be compared.

    Attributes:
        settings: flags of `pocketgs train` common to all cells.
        sources: see `pocketgs.benchmark.sources`.
        machine: see `pocketgs.benchmark.machine`.
    """

    settings: str
    sources: str
    machine: dict[str, str]


def present_conditions(common_flags: Sequence[str]) -> Conditions:
    """The conditions of a cell that runs now, on this machine, with these common flags."""
    return Conditions(shlex.join(common_flags), digest_of_sources(), describe_machine())
