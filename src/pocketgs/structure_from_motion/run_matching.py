"""Matching pairs of photographs, in several processes side by side."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from pocketgs.structure_from_motion.colmap.matching_job import MatchingJob
from pocketgs.structure_from_motion.photographs import Photograph
from pocketgs.structure_from_motion.process import run_side_by_side
from pocketgs.structure_from_motion.work import Count
from pocketgs.system.cores import usable_cores
from pocketgs.system.free_memory import free_memory

PAIRS_PER_PROCESS = 40
"""Minimum number of pairs per process: matching as many takes a few times as long as starting COLMAP."""

BYTES_OF_A_PROCESS, BYTES_PER_PHOTOGRAPH = 120e6, 2e6
"""Memory, measured with 4,500 features per photograph, if each process uses all of them."""


def match(
    photographs: Sequence[Photograph], pairs: Sequence[tuple[str, str]], workspace: Path, on_count: Count
) -> list[str]:
    """Match the features of pairs of photographs.

    Args:
        photographs: with their features.
        pairs: of names, in an order in which consecutive ones share photographs.
        workspace: folder for intermediate files.
        on_count: called with the number of pairs done, and their total.

    Returns:
        Files with the matches, see `colmap/match_file.py`. The matches are the same for any number of processes.

    Raises:
        PocketGSError: COLMAP failed.
    """
    features = {photograph.name: str(photograph.file) for photograph in photographs}
    shares = _shares(pairs, _processes(len(pairs), len(photographs), workspace))
    jobs: list[MatchingJob] = [
        {
            "database": str(workspace / f"matching_{number}.db"),
            "features": features,
            "pairs": share,
            "matches": str(workspace / f"matches_{number}.npz"),
        }
        for number, share in enumerate(shares)
    ]
    run_side_by_side("matching", jobs, workspace, lambda done: on_count(done, len(pairs)))
    return [job["matches"] for job in jobs]


def _shares(pairs: Sequence[tuple[str, str]], count: int) -> list[list[tuple[str, str]]]:
    """Consecutive parts of nearly equal size."""
    bounds = [len(pairs) * number // count for number in range(count + 1)]
    return [list(pairs[start:end]) for start, end in pairwise(bounds)]


def _processes(pairs: int, photographs: int, workspace: Path) -> int:
    """Number of processes that are worth starting, and fit half of the free memory and of the free disk."""
    room = min(free_memory(), shutil.disk_usage(workspace).free) / 2
    fitting = room // (BYTES_OF_A_PROCESS + BYTES_PER_PHOTOGRAPH * photographs)
    return max(1, min(usable_cores(), int(fitting), pairs // PAIRS_PER_PROCESS))
