"""COLMAP's mappers, and what they find without the images that its matches contradict."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pycolmap

from pocketgs.structure_from_motion.colmap.agreement import Split, forget, split
from pocketgs.structure_from_motion.colmap.job import announce, announce_count
from pocketgs.structure_from_motion.colmap.lenses import has_square_pixels
from pocketgs.structure_from_motion.colmap.mapping_job import MappingJob

MIN_MODEL, MIN_POINTS = 3, 20
"""Minimum number of images and of points of a model."""

MIN_POINTS_PER_IMAGE = 20
"""Minimum number of points of a model of images that were placed all at once, per image."""


class Agreeing(NamedTuple):
    """A model whose poses its matches agree with.

    Attributes:
        model: with these images.
        rest: numbers of images of the other parts that it was joined to, largest first.
    """

    model: pycolmap.Reconstruction
    rest: list[int]


def agreeing_models(job: MappingJob, database: Path) -> list[Agreeing]:
    """Map images, and take apart what its matches contradict. The models, largest first.

    The largest model goes on without the matches that joined it to the other parts, whose images may find another place
    by the matches that remain.
    """
    parts = _parts(MAPPERS[job["mapper"]](job, database), job, database)
    if not parts:
        return []
    largest, rest = parts[0]
    while rest.parts:
        with pycolmap.Database.open(database) as opened:
            forget(rest.joints, opened)
        found = _parts(_go_on_from(largest, job, database), job, database)
        if not found or found[0][0].num_reg_images() <= largest.num_reg_images():
            break
        largest, rest = found[0]
    others = [part for part in parts[1:] if not _images(part[0]) <= _images(largest)]
    return [Agreeing(model, rest.parts) for model, rest in [(largest, rest), *others]]


def _images(model: pycolmap.Reconstruction) -> set[int]:
    """The numbers of the images with a pose."""
    return {number for number, image in model.images.items() if image.has_pose}


def _parts(
    models: list[pycolmap.Reconstruction], job: MappingJob, database: Path
) -> list[tuple[pycolmap.Reconstruction, Split]]:
    """The largest part of each model, largest first."""
    with pycolmap.Database.open(database) as opened:
        parts = [(model, split(model, opened, job["refine_lenses"])) for model in models if _is_model(model)]
    kept = [part for part in parts if _is_model(part[0])]
    return sorted(kept, key=lambda part: (part[0].num_reg_images(), part[0].num_points3D()), reverse=True)


def _is_model(found: pycolmap.Reconstruction) -> bool:
    """Whether enough is left: where the camera only turned, COLMAP places images and then discards their points."""
    return found.num_reg_images() >= MIN_MODEL and found.num_points3D() >= MIN_POINTS


def _map_incrementally(job: MappingJob, database: Path) -> list[pycolmap.Reconstruction]:
    """Start from two images, or from an earlier model, and add one after the other."""
    options = _incremental_options(job)
    if job["go_on"]:
        return _add_images(job, database, options, Path(job["raw_model"]), job["better_than"])
    options.multiple_models = True
    return _add_images(job, database, options, None, 2)


def _go_on_from(model: pycolmap.Reconstruction, job: MappingJob, database: Path) -> list[pycolmap.Reconstruction]:
    """Add images to a model whose points they see."""
    options = _incremental_options(job)
    options.structure_less_registration_fallback = False
    start = database.with_name("agreeing")
    start.mkdir(exist_ok=True)
    model.write_binary(start)
    return _add_images(job, database, options, start, model.num_reg_images())


def _incremental_options(job: MappingJob) -> pycolmap.IncrementalPipelineOptions:
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = job["seed"]
    # With several threads, sums are in any order, and bundle adjustment amplifies the difference.
    options.num_threads = 1
    options.min_model_size = MIN_MODEL
    options.extract_colors = False
    options.min_num_matches = job["least_matches"]
    options.mapper.abs_pose_min_num_inliers = 2 * job["least_matches"]
    options.ba_refine_focal_length = options.ba_refine_extra_params = job["refine_lenses"]
    options.multiple_models = False
    return options


def _add_images(
    job: MappingJob, database: Path, options: pycolmap.IncrementalPipelineOptions, start: Path | None, placed: int
) -> list[pycolmap.Reconstruction]:
    """Run COLMAP's incremental mapper from a model with a number of placed images, and report its progress."""
    working = database.with_name("models")
    working.mkdir(exist_ok=True)
    images = sum(len(camera["images"]) for camera in job["cameras"])
    count = placed

    def begin() -> None:
        """Each model is timed by itself."""
        nonlocal count
        count = placed
        announce("mapping")
        announce_count(count, images)

    def place_next() -> None:
        nonlocal count
        count += 1
        announce_count(min(count, images), images)  # an image that was discarded is placed again

    found = pycolmap.incremental_mapping(
        database,
        database.parent,
        working,
        options,
        input_path=start or "",
        initial_image_pair_callback=begin,
        next_image_callback=place_next,
    )
    return list(found.values())


def _map_globally(job: MappingJob, database: Path) -> list[pycolmap.Reconstruction]:
    """Place all images at once (GLOMAP, Pan et al. 2024), which needs no two images to start from.

    It places images by few and wrong matches too: a model with few points, or with a lens that makes no sense, is none.
    """
    options = pycolmap.GlobalPipelineOptions()
    options.min_num_matches = job["least_matches"]
    options.min_model_size = MIN_MODEL
    mapper = options.mapper
    for each in (options, mapper, mapper.rotation_averaging, mapper.global_positioning):
        each.random_seed = job["seed"]
    options.num_threads = mapper.num_threads = 1  # as for the other mapper
    lens = mapper.bundle_adjustment
    lens.refine_focal_length = lens.refine_extra_params = job["refine_lenses"]
    working = database.with_name("global_models")
    working.mkdir(exist_ok=True)
    found = pycolmap.global_mapping(database, database.parent, working, options)
    return [
        model
        for model in found.values()
        if model.num_points3D() >= MIN_POINTS_PER_IMAGE * model.num_reg_images()
        and all(map(has_square_pixels, model.cameras.values()))
    ]


MAPPERS = {"incremental": _map_incrementally, "global": _map_globally}
