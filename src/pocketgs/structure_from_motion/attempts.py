"""Registering photographs in steps: with the likeliest pairs, with more pairs, with a lower match threshold, and all at
once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from pocketgs.structure_from_motion.colmap.mapping_job import MappedCamera, MappingJob, MappingOutcome
from pocketgs.structure_from_motion.gps import local_metres
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.pairs import (
    MAX_FOR_ALL_PAIRS,
    Pairs,
    all_pairs,
    chosen_pairs,
    likeliest_pairs,
    sequences,
)
from pocketgs.structure_from_motion.photographs import Photograph, cameras_of, focal_length
from pocketgs.structure_from_motion.process import run_colmap
from pocketgs.structure_from_motion.retrieval import similarities
from pocketgs.structure_from_motion.run_matching import match
from pocketgs.structure_from_motion.work import Count

MIN_MATCHES, MIN_MATCHES_RELAXED = 15, 10
"""Minimum number of matches per pair: COLMAP's default, and the value used if too few photographs are registered."""

MIN_SHARE = 0.8
"""Share of photographs that must be registered; below it the lower match threshold is tried."""

MIN_PARALLAX_SHARE = 0.1
"""Minimum share of the matching pairs in which the camera did not only turn, for placing all photographs at once:
otherwise errors of the lens would pass for parallax."""

MAX_EXTRA_PAIRS = 5000
"""Maximum number of pairs with photographs that were not registered at first: matching takes longest."""


def place_all(
    photographs: Sequence[Photograph],
    in_order: bool,
    model: Path,
    workspace: Path,
    options: PoseOptions,
    on_stage: Callable[[str], None],
    on_count: Count,
) -> MappingOutcome:
    """Find the poses of as many photographs as possible.

    Args:
        photographs: with their features.
        in_order: whether they are known to be in capture order.
        model: output folder for COLMAP's model.
        workspace: folder for intermediate files.
        options: of structure from motion.
        on_stage: called with "matching", "verification" and "mapping".
        on_count: called with the progress of a stage.

    Returns:
        The attempt that registered most photographs.

    Raises:
        PocketGSError: COLMAP failed.
    """
    names = [photograph.name for photograph in photographs]
    places = local_metres([photograph.exif.place for photograph in photographs])
    likeness = _likeness(photographs, options.seed)
    pairs = _first_pairs(names, likeness, in_order, places)
    job = _job(photographs, places, model, workspace, options)

    def attempt(pairs: Pairs, **changes: Any) -> MappingOutcome:
        listed = [(names[first], names[second]) for first, second in sorted(pairs)]
        matches: list[str] = []
        if listed:
            on_stage("matching")
            matches = match(photographs, listed, workspace, on_count)
        asked = {**job, "matches": matches, **changes}
        found = run_colmap("verify_and_map", asked, workspace / "log.txt", on_stage, on_count)
        return cast(MappingOutcome, {**found, "lenses_refined": asked["refine_lenses"]})

    def at_once() -> MappingOutcome:
        """Place all photographs together, with lenses as they are stated if the motion does not determine them."""
        found = attempt(set(), mapper="global", better_than=_placed(best))
        if found["placed"]:
            return found
        return attempt(set(), mapper="global", better_than=_placed(best), refine_lenses=False)

    best = attempt(pairs)
    if best["stands_still"]:
        return best
    # A later attempt replaces the model only if it registers more photographs.
    lacking = [index for index, name in enumerate(names) if name not in best["placed"]]
    more = likeliest_pairs(likeness, lacking, pairs, MAX_EXTRA_PAIRS)
    if more:
        go_on = len(lacking) < len(names) / 4
        best = max(best, attempt(more, go_on=go_on, better_than=_placed(best)), key=_placed)
    if _reached(best) < MIN_SHARE * len(names):
        tolerant = attempt(set(), least_matches=MIN_MATCHES_RELAXED, better_than=_placed(best))
        best = max(best, tolerant, key=_placed)
    if _reached(best) < MIN_SHARE * len(names) and _moved(best):
        best = max(best, at_once(), key=_placed)
    return best


def _moved(outcome: MappingOutcome) -> bool:
    """Whether the camera changed its place, and did not only turn."""
    return outcome["parallax_pairs"] > MIN_PARALLAX_SHARE * outcome["matched_pairs"]


def _placed(outcome: MappingOutcome) -> int:
    return len(outcome["placed"])


def _reached(outcome: MappingOutcome) -> int:
    """Number of images with enough matches for a place, be it a wrong one: more matches do not help these."""
    return _placed(outcome) + outcome.get("contradicted", 0)


def _likeness(photographs: Sequence[Photograph], seed: int) -> np.ndarray:
    """(F, F) similarity; the same for all pairs of few photographs, which are matched anyway."""
    count = len(photographs)
    if count <= MAX_FOR_ALL_PAIRS:
        return np.zeros((count, count), np.float32)
    return similarities([photograph.strongest for photograph in photographs], seed)


def _first_pairs(names: Sequence[str], likeness: np.ndarray, in_order: bool, places: np.ndarray | None) -> Pairs:
    if len(names) <= MAX_FOR_ALL_PAIRS:
        return all_pairs(len(names))
    return chosen_pairs(likeness, [range(len(names))] if in_order else sequences(names), places)


def _job(
    photographs: Sequence[Photograph], places: np.ndarray | None, model: Path, workspace: Path, options: PoseOptions
) -> MappingJob:
    raw_model = workspace / "raw"
    raw_model.mkdir()
    known = [] if places is None else zip(photographs, places.tolist(), strict=True)
    return {
        "database": str(workspace / "features.db"),
        "model": str(model),
        "raw_model": str(raw_model),
        "cameras": [_camera(group, options) for group in cameras_of(photographs)],
        "matches": [],
        "places": {photograph.name: place for photograph, place in known if np.isfinite(place).all()},
        "least_matches": MIN_MATCHES,
        "mapper": "incremental",
        "refine_lenses": True,
        "go_on": False,
        "better_than": 0,
        "seed": options.seed,
    }


def _camera(group: Sequence[Photograph], options: PoseOptions) -> MappedCamera:
    focal, is_known = focal_length(group[0])
    return {
        "model": options.camera_model,
        "focal_length": focal,
        "focal_length_is_known": is_known,
        "size": list(group[0].reduced_size),
        "full_size": list(group[0].size),
        "images": [{"name": photograph.name, "features": str(photograph.file)} for photograph in group],
    }
