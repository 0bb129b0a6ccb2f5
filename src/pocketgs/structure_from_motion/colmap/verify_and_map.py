"""COLMAP's verification and mapping.

Run as `python -m pocketgs.structure_from_motion.colmap.verify_and_map`; see `job`. No image is decoded here: features
and colours arrive as arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pycolmap

from pocketgs.structure_from_motion.colmap.bundle_adjustment import adjust_bundle
from pocketgs.structure_from_motion.colmap.database import add_camera, add_image, number_names, write_pairs
from pocketgs.structure_from_motion.colmap.job import announce, announce_count, serve
from pocketgs.structure_from_motion.colmap.lenses import FAR, simple_lens, with_requested_lenses
from pocketgs.structure_from_motion.colmap.mapping import MIN_MODEL, agreeing_models
from pocketgs.structure_from_motion.colmap.mapping_job import MappingJob, MappingOutcome
from pocketgs.structure_from_motion.colmap.match_file import read_match_file
from pocketgs.structure_from_motion.colmap.stillness import match_shifts, stands_still
from pocketgs.structure_from_motion.colmap.world import from_places, upright

AS_GOOD = 1.1
"""Maximum ratio of reprojection errors to take another focal length."""

WITH_PARALLAX = (
    pycolmap.TwoViewGeometryConfiguration.CALIBRATED.value,
    pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED.value,
)
"""Kinds of pairs whose matches no homography explains. Where the camera only turned, one explains them."""

WITHOUT_PARALLAX = (
    pycolmap.TwoViewGeometryConfiguration.PLANAR,
    pycolmap.TwoViewGeometryConfiguration.PANORAMIC,
    pycolmap.TwoViewGeometryConfiguration.PLANAR_OR_PANORAMIC,
)
MIN_FLAT, MIN_FLAT_SHARE = 3, 0.75
"""Minimum number, and share, of an image's pairs that homographies explain where the camera only turned, or saw nothing
but a flat surface. A single pair tells little: with few matches, a homography explains many.
"""

PAIRS_AT_ONCE = 60
"""Pairs verified between two progress reports."""


def run(job: MappingJob) -> MappingOutcome:
    """Find the poses of images and write the largest resulting model."""
    database = Path(job["database"])
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    pycolmap.set_random_seed(job["seed"])
    names = _names(job)
    if not database.exists():
        _fill(job, database)
    announce("verification")
    _verify(job, database)
    with pycolmap.Database.open(database) as found:
        numbers, geometries = found.read_two_view_geometries()
        outcome: MappingOutcome = {
            "placed": [],
            "matched_pairs": sum(len(geometry.inlier_matches) > 0 for geometry in geometries),
            "parallax_pairs": sum(geometry.config in WITH_PARALLAX for geometry in geometries),
            "without_parallax": _without_parallax(found, numbers, geometries, names),
            "stands_still": stands_still(match_shifts(found, numbers, geometries)),
        }
    if outcome["stands_still"]:
        return outcome
    announce("mapping")
    models = agreeing_models(job, database)
    if not models:
        return outcome
    (largest, rest), *others = models
    parts = [*rest, *(other.model.num_reg_images() for other in others)]
    outcome["placed"] = sorted(names[image.name] for image in largest.images.values() if image.has_pose)
    if len(outcome["placed"]) <= job["better_than"]:
        return outcome
    largest = _with_stated_focal_lengths(job, largest)
    largest.write_binary(job["raw_model"])
    largest = with_requested_lenses(job, largest)
    for image in largest.images.values():
        image.name = names[image.name]
    _enlarge(job, largest)
    _colour(job, largest)
    metric = _settle(job, largest)
    largest.write_binary(job["model"])
    return {
        **outcome,
        "points": largest.num_points3D(),
        "reprojection_error": largest.compute_mean_reprojection_error(),
        "track_length": largest.compute_mean_track_length(),
        "contradicted": sum(rest),
        "other_models": sorted((images for images in parts if images >= MIN_MODEL), reverse=True),
        "metric": metric,
    }


def _without_parallax(
    database: pycolmap.Database,
    pairs: Sequence[int],
    geometries: Sequence[pycolmap.TwoViewGeometry],
    names: Mapping[str, str],
) -> list[str]:
    """Names of the images that match others, nearly all by homographies, which determine no place."""
    name_of = {image.image_id: names[image.name] for image in database.read_all_images()}
    is_flat: dict[str, list[bool]] = {}
    for pair, geometry in zip(pairs, geometries, strict=True):
        if len(geometry.inlier_matches):
            for number in pycolmap.pair_id_to_image_pair(pair):
                is_flat.setdefault(name_of[number], []).append(geometry.config in WITHOUT_PARALLAX)
    return sorted(name for name, flat in is_flat.items() if sum(flat) >= max(MIN_FLAT, MIN_FLAT_SHARE * len(flat)))


def _names(job: MappingJob) -> dict[str, str]:
    """The images' names by those in the database."""
    names = [image["name"] for camera in job["cameras"] for image in camera["images"]]
    return dict(zip(number_names(len(names)), names, strict=True))


def _fill(job: MappingJob, database: Path) -> None:
    """Create the database with cameras, images and their features."""
    numbers = iter(_names(job))
    with pycolmap.Database.open(database) as made, pycolmap.DatabaseTransaction(made):
        for number, camera in enumerate(job["cameras"], start=1):
            width, height = camera["size"]
            lens = pycolmap.Camera.create_from_model_name(
                number, simple_lens(camera["model"]), camera["focal_length"], width, height
            )
            lens.has_prior_focal_length = camera["focal_length_is_known"]
            rig = add_camera(made, lens)
            for image in camera["images"]:
                add_image(made, next(numbers), image["features"], number, rig)


def _verify(job: MappingJob, database: Path) -> None:
    """Find the matches that agree with a camera's motion: of the job's pairs, or of all pairs once more."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = job["seed"]
    options.min_num_inliers = job["least_matches"]
    with pycolmap.Database.open(database) as found:
        if job["matches"]:
            pairs = _add_matches(job, found)
        else:
            found.clear_two_view_geometries()
            pairs = _matched(found)
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        some = pairs[start : start + PAIRS_AT_ONCE]
        # Pairs that have matches are only verified.
        pycolmap.match_image_pairs(
            database,
            pairing_options=write_pairs(database, some),
            verification_options=options,
            device=pycolmap.Device.cpu,
        )
        announce_count(start + len(some), len(pairs))
    with pycolmap.Database.open(database) as found:
        verified, matched = found.num_verified_image_pairs(), found.num_matched_image_pairs()
    if verified != matched:  # an error in a thread of COLMAP's ends as silence
        raise RuntimeError(f"{verified} of {matched} pairs were verified")


def _add_matches(job: MappingJob, database: pycolmap.Database) -> list[tuple[str, str]]:
    """Write the job's matches to the database. Returns the pairs, by their names there."""
    in_database = {name: number for number, name in _names(job).items()}
    numbers = {image.name: image.image_id for image in database.read_all_images()}
    pairs = []
    with pycolmap.DatabaseTransaction(database):
        for file in job["matches"]:
            for pair, matches in read_match_file(file).items():
                first, second = (in_database[name] for name in pair)
                database.write_matches(numbers[first], numbers[second], matches)
                pairs.append((first, second))
    return pairs


def _matched(database: pycolmap.Database) -> list[tuple[str, str]]:
    """The pairs that have matches, by their names in the database."""
    names = {image.image_id: image.name for image in database.read_all_images()}
    numbers = [pycolmap.pair_id_to_image_pair(pair) for pair in database.read_num_matches()[0]]
    return [(names[first], names[second]) for first, second in numbers]


def _with_stated_focal_lengths(job: MappingJob, model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """The model with EXIF's focal lengths, where these differ much from the estimated ones and fit as well.

    From straight above flat ground, for example, the focal length is undetermined: any value explains the photographs.
    """
    stated = {
        number: camera["focal_length"]
        for number, camera in enumerate(job["cameras"], start=1)
        if camera["focal_length_is_known"] and number in model.cameras
    }
    far = [number for number in stated if abs(_log_ratio(model.cameras[number], stated[number])) > FAR]
    if not far:
        return model
    other = pycolmap.Reconstruction(model)
    for number in far:
        camera = other.cameras[number]
        parameters = np.array(camera.params)
        parameters[list(camera.focal_length_idxs())] = stated[number]
        camera.params = parameters.tolist()
    adjust_bundle(other, refine_focal_length=False)
    other.update_point_3d_errors()
    as_good = other.compute_mean_reprojection_error() <= AS_GOOD * model.compute_mean_reprojection_error()
    return other if as_good else model


def _log_ratio(camera: pycolmap.Camera, focal_length: float) -> float:
    return float(np.log(camera.mean_focal_length() / focal_length))


def _enlarge(job: MappingJob, model: pycolmap.Reconstruction) -> None:
    """Scale from pixels of the reduced images to those of the full ones."""
    for number, camera in enumerate(job["cameras"], start=1):
        if number not in model.cameras:
            continue
        width, height = camera["full_size"]
        factors = np.array(camera["full_size"]) / np.array(camera["size"])
        model.cameras[number].rescale(width, height)
        for image in model.images.values():
            if image.camera_id == number:
                for point in image.points2D:
                    point.xy = point.xy * factors
    model.update_point_3d_errors()


def _colour(job: MappingJob, model: pycolmap.Reconstruction) -> None:
    """Set each point's colour to the mean of its features' colours."""
    files = {image["name"]: image["features"] for camera in job["cameras"] for image in camera["images"]}
    numbers = {number: row for row, number in enumerate(model.points3D)}
    sums = np.zeros((len(numbers), 4))
    for image in model.images.values():
        if not image.has_pose:
            continue
        seen = [(i, numbers[point.point3D_id]) for i, point in enumerate(image.points2D) if point.has_point3D()]
        if not seen:
            continue
        features, points = np.array(seen).T
        with np.load(files[image.name]) as stored:
            np.add.at(sums, points, np.insert(stored["colours"][features], 3, 1, axis=1))
    for number, row in numbers.items():
        model.points3D[number].color = np.rint(sums[row, :3] / max(sums[row, 3], 1.0)).astype(np.uint8)


def _settle(job: MappingJob, model: pycolmap.Reconstruction) -> bool:
    """Transform the model to its final world. Returns whether lengths are metres."""
    images = [image for image in model.images.values() if image.has_pose]
    rotations = np.array([image.cam_from_world().rotation.matrix() for image in images])
    centres = np.array([image.projection_center() for image in images])
    points = np.array([point.xyz for point in model.points3D.values()])
    places = np.array([job["places"].get(image.name) or [np.nan] * 3 for image in images])
    found = from_places(centres, places)
    chosen = found or upright(rotations, centres, points)
    model.transform(pycolmap.Sim3d(chosen.scale, pycolmap.Rotation3d(chosen.rotation), chosen.shift))
    return found is not None


if __name__ == "__main__":
    serve(run)
