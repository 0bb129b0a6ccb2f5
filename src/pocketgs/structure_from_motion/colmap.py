"""COLMAP's pipeline, run as `python -m pocketgs.structure_from_motion.colmap` in a process of its own; see `job`."""

from __future__ import annotations

from pathlib import Path

import pycolmap

from pocketgs.structure_from_motion.extraction import extract_features, import_images
from pocketgs.structure_from_motion.job import Job, Outcome, announce, serve

# A phone's main camera without EXIF data: focal length over the longer side. COLMAP's own 1.2 is that of a short
# telephoto lens. Bundle adjustment refines it.
PHONE_FOCAL_LENGTH = 0.8
SMALLEST_MODEL = 3


def run(job: Job) -> Outcome:
    """Find the poses of some images and write the largest model that comes of it.

    Args:
        job: `images` and `model`, folders; `database`, a file to be made; `groups`, lists of image names, each taken
            by one camera; `ordered`, whether neighbours by name overlap; `camera_model`, `max_size`, `seed`, `threads`
            as in COLMAP.

    Returns:
        What was found: images `registered`, `points`, mean `reprojection_error` in pixels, and by how much of the
        images: `features`, `matched_pairs`.
    """
    database = Path(job["database"])
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    pycolmap.set_random_seed(job["seed"])
    announce("features")
    _extract(job, database)
    announce("matching")
    _match(job, database)
    announce("mapping")
    models = _map(job, database)
    with pycolmap.Database.open(database) as found:
        _, inliers = found.read_two_view_geometry_num_inliers()
        matched_pairs = sum(count > 0 for count in inliers)
        outcome = {"features": found.num_keypoints(), "matched_pairs": matched_pairs}
    if not models:
        return {**outcome, "registered": 0}
    largest = max(models, key=lambda model: (model.num_reg_images(), model.num_points3D()))
    largest.write_binary(job["model"])
    return {
        **outcome,
        "registered": largest.num_reg_images(),
        "points": largest.num_points3D(),
        "reprojection_error": largest.compute_mean_reprojection_error(),
    }


def _extract(job: Job, database: Path) -> None:
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = job["camera_model"]
    reader.default_focal_length_factor = PHONE_FOCAL_LENGTH
    import_images(job, database, job["groups"], pycolmap.CameraMode.SINGLE, reader)
    extract_features(job, database, job["groups"], pycolmap.CameraMode.SINGLE, reader)


def _match(job: Job, database: Path) -> None:
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = job["seed"]
    # In sequence an image meets its 10 neighbours, and ever fewer at 16, 32, ... to 512, which closes loops.
    match = pycolmap.match_sequential if job["ordered"] else pycolmap.match_exhaustive
    match(database, verification_options=verification, device=pycolmap.Device.cpu)


def _map(job: Job, database: Path) -> list[pycolmap.Reconstruction]:
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = job["seed"]
    # The sums of several threads come in any order, and bundle adjustment makes their last bits visible.
    options.num_threads = 1
    options.min_model_size = SMALLEST_MODEL
    working = database.with_name("models")
    working.mkdir()
    return list(pycolmap.incremental_mapping(database, job["images"], working, options).values())


if __name__ == "__main__":
    serve(run)
