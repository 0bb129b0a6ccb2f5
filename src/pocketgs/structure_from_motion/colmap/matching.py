"""COLMAP's matching of features, run as `python -m pocketgs.structure_from_motion.colmap.matching`; see `job`.

One thread per process: with several, COLMAP calls its BLAS from all of them at once. The one in its wheels is built for
a single thread, and two calls may share memory: then matches are missing or wrong, about once in a thousand runs. See
https://github.com/OpenMathLib/OpenBLAS/issues/1755.
"""

from __future__ import annotations

from pathlib import Path

import pycolmap

from pocketgs.structure_from_motion.colmap.database import add_camera, add_image, number_names, write_pairs
from pocketgs.structure_from_motion.colmap.job import announce_count, serve
from pocketgs.structure_from_motion.colmap.match_file import write_match_file
from pocketgs.structure_from_motion.colmap.matching_job import MatchingJob, MatchingOutcome

PAIRS_AT_ONCE = 200
"""Pairs matched between two progress reports. Each time, COLMAP indexes their images again: for each image, that takes
a third as long as matching a pair."""


def run(job: MatchingJob) -> MatchingOutcome:
    """Match the features of pairs of images, and write the matches.

    Raises:
        RuntimeError: COLMAP left pairs out.
    """
    database, pairs = Path(job["database"]), job["pairs"]
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    names = dict(zip(job["features"], number_names(len(job["features"])), strict=True))
    numbers = _fill(job, names, database)
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        some = pairs[start : start + PAIRS_AT_ONCE]
        match_pairs(database, write_pairs(database, [(names[first], names[second]) for first, second in some]))
        announce_count(start + len(some), len(pairs))
    with pycolmap.Database.open(database) as found:
        if found.num_matched_image_pairs() != len(pairs):  # an error in a thread of COLMAP's ends as silence
            raise RuntimeError(f"{found.num_matched_image_pairs()} of {len(pairs)} pairs were matched")
        read = {(first, second): found.read_matches(numbers[first], numbers[second]) for first, second in pairs}
    database.unlink()  # features take most of the space that finding poses needs
    matches = {pair: rows for pair, rows in read.items() if len(rows)}
    write_match_file(job["matches"], matches)
    return {"matched_pairs": len(matches)}


def match_pairs(database: Path, pairing: pycolmap.ImportedPairingOptions) -> None:
    """Match pairs of images of a database in one thread, without verification."""
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = 1
    options.skip_geometric_verification = True
    pycolmap.match_image_pairs(database, matching_options=options, pairing_options=pairing, device=pycolmap.Device.cpu)


def _fill(job: MatchingJob, names: dict[str, str], database: Path) -> dict[str, int]:
    """Create the database with the images of the pairs, and return their numbers."""
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 1.0, 1, 1)  # of no use to matching
    with pycolmap.Database.open(database) as made, pycolmap.DatabaseTransaction(made):
        rig = add_camera(made, camera)
        images = sorted({name for pair in job["pairs"] for name in pair})
        return {name: add_image(made, names[name], job["features"][name], 1, rig) for name in images}


if __name__ == "__main__":
    serve(run)
