"""Feature extraction into a COLMAP database, the first step of every COLMAP job. Runs in the child process."""

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
    """Create the database and import images into it, group by group.

    This comes before extraction, whose threads would number the images in the order in which they finish.

    Args:
        job: `images`, a folder.
        database: file to create.
        groups: names of images.
        mode: which images of a group share a camera.
        reader: camera options.
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
    """Extract features of the images in the database.

    Args:
        job: `images`, a folder; `max_size` and `threads` as in COLMAP.
        database: with the images.
        groups: as imported.
        mode: as imported.
        reader: as imported.
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
