"""Features of images in a COLMAP database: what every job for COLMAP begins with. Runs in the child's process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pycolmap

from pocketgs.structure_from_motion.job import Job


def import_images(
    job: Job,
    database: Path,
    groups: Sequence[list[str]],
    mode: pycolmap.CameraMode,
    reader: pycolmap.ImageReaderOptions,
) -> None:
    """Make the database and list the images in it, group by group.

    It is done before the extraction, whose threads would number the images in the order in which they finish.

    Args:
        job: `images`, a folder.
        database: a file to be made.
        groups: names of images.
        mode: which images of a group share a camera.
        reader: what cameras are taken for.
    """
    pycolmap.Database.open(database).close()
    for names in groups:
        pycolmap.import_images(database, job["images"], mode, names, reader)


def extract_features(
    job: Job,
    database: Path,
    groups: Sequence[list[str]],
    mode: pycolmap.CameraMode,
    reader: pycolmap.ImageReaderOptions,
) -> None:
    """Find the features of images that the database lists.

    Args:
        job: `images`, a folder; `max_size` and `threads` as in COLMAP.
        database: with the images.
        groups: as they were imported.
        mode: as they were imported.
        reader: as they were imported.
    """
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.max_image_size = job["max_size"]
    extraction.num_threads = job["threads"]
    for names in groups:
        pycolmap.extract_features(
            database,
            job["images"],
            names,
            mode,
            reader_options=reader,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
