"""What runs must have in common to stand in one table."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from pocketgs.bench.machine import describe_machine
from pocketgs.bench.sources import digest_of_sources


@dataclass(frozen=True)
class Conditions:
    """What runs must have in common to stand in one table.

    Attributes:
        settings: flags of `pocketgs train` that all cells have, as one types them.
        sources: see `pocketgs.bench.sources`.
        machine: see `pocketgs.bench.machine`.
    """

    settings: str
    sources: str
    machine: dict[str, str]


def present_conditions(common_flags: Sequence[str]) -> Conditions:
    """Those of a cell that is run now, on this machine, with these flags besides its own."""
    return Conditions(shlex.join(common_flags), digest_of_sources(), describe_machine())
