"""COLMAP's triangulation at known poses.

Run as `python -m pocketgs.structure_from_motion.colmap.triangulation`; see `job`.
"""

from __future__ import annotations

from pathlib import Path

import pycolmap

from pocketgs.structure_from_motion.colmap.job import announce, serve
from pocketgs.structure_from_motion.colmap.matching import match_pairs
from pocketgs.structure_from_motion.colmap.triangulation_job import PosedCamera, TriangulationJob, TriangulationOutcome


def run(job: TriangulationJob) -> TriangulationOutcome:
    """Triangulate the sparse cloud of images with known poses, and write it as a COLMAP model."""
    database = Path(job["database"])
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    pycolmap.set_random_seed(job["seed"])
    announce("features")
    _extract(job, database)
    announce("matching")
    _match(job, database)
    announce("triangulation")
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = job["seed"]
    options.num_threads = 1  # with several threads, sums are in any order
    model = pycolmap.triangulate_points(_posed(job, database), database, job["images"], job["model"], options=options)
    model.write_binary(job["model"])
    return {"points": model.num_points3D(), "reprojection_error": model.compute_mean_reprojection_error()}


def _extract(job: TriangulationJob, database: Path) -> None:
    """Create the database with all images, each with a camera of its own, and extract their features.

    Images are imported before extraction, whose threads would number them in the order in which they finish.
    """
    names, mode = sorted(job["cameras"]), pycolmap.CameraMode.PER_IMAGE
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.mask_path = job["masks"] or ""
    pycolmap.Database.open(database).close()
    pycolmap.import_images(database, job["images"], mode, names, reader)
    with pycolmap.Database.open(database) as found:
        for image in found.read_all_images():
            found.update_camera(_camera(image.camera_id, job["cameras"][image.name]))
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.max_image_size = job["max_size"]
    extraction.num_threads = job["threads"]
    pycolmap.extract_features(
        database,
        job["images"],
        names,
        mode,
        reader_options=reader,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )


def _match(job: TriangulationJob, database: Path) -> None:
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = job["seed"]
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = job["pairs"]
    match_pairs(database, pairing)
    with pycolmap.Database.open(database) as found:
        found.clear_two_view_geometries()
    # Pairs that have matches are only verified, by several threads.
    pycolmap.match_image_pairs(
        database, pairing_options=pairing, verification_options=verification, device=pycolmap.Device.cpu
    )


def _posed(job: TriangulationJob, database: Path) -> pycolmap.Reconstruction:
    """A model without points, with every image at its pose, numbered as in the database."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as found:
        for image in found.read_all_images():
            camera = job["cameras"][image.name]
            model.add_camera_with_trivial_rig(_camera(image.camera_id, camera))
            posed = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id)
            model.add_image_with_trivial_frame(posed, pycolmap.Rigid3d(camera["world_to_camera"]))
    return model


def _camera(number: int, camera: PosedCamera) -> pycolmap.Camera:
    width, height = camera["size"]
    parameters = camera["intrinsics"]
    found = pycolmap.Camera(camera_id=number, model="PINHOLE", width=width, height=height, params=parameters)
    found.has_prior_focal_length = True
    return found


if __name__ == "__main__":
    serve(run)
