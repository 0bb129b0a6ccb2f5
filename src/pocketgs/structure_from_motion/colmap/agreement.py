"""Parts of a model that its matches contradict.

COLMAP adds an image if a few points support its pose, and says nothing of matches that do not. So it joins parts of a
room by an object that stands there twice, folds an object whose sides look alike, or places images by chance: fog.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pycolmap

from pocketgs.geometry.agreement import PAIR_FIT, agreeing_groups
from pocketgs.geometry.epipolar import essential_matrix, sampson_distances
from pocketgs.structure_from_motion.colmap.bundle_adjustment import adjust_bundle

TOLERANCE = 4.0
"""Distance in pixels from epipolar lines up to which a match fits: that of COLMAP's verification."""

JOINED = 0.5
"""Share of a pair's matches above which they join its images: by chance, up to half lie near epipolar lines."""

MAX_ERROR, MIN_ANGLE = 4.0, 1.5
"""Reprojection error in pixels and angle between rays in degrees by which COLMAP's mapper filters points."""


class Split(NamedTuple):
    """What `split` took from a model.

    Attributes:
        parts: numbers of images of the other parts, largest first.
        joints: pairs of images whose matches joined those to the largest part.
    """

    parts: list[int]
    joints: list[tuple[int, int]]


def split(model: pycolmap.Reconstruction, database: pycolmap.Database, refine_lenses: bool) -> Split:
    """Keep the largest part of a model whose verified matches agree with its poses.

    The rest loses its poses, and bundle adjustment is repeated without it.

    Args:
        model: changed.
        database: with the images' features and verified matches.
        refine_lenses: whether bundle adjustment may change lenses.
    """
    images = sorted(number for number, image in model.images.items() if image.has_pose)
    total, fit = _matches(model, database, images)
    group = agreeing_groups(total, total * _support(fit))
    sizes = np.bincount(group)
    kept = group == sizes.argmax()
    if kept.all():
        return Split([], [])
    for number in np.array(images)[~kept].tolist():
        model.deregister_frame(model.images[number].frame_id)
    adjust_bundle(model, refine_focal_length=refine_lenses, refine_extra_params=refine_lenses)
    pycolmap.ObservationManager(model).filter_all_points3D(MAX_ERROR, MIN_ANGLE)
    model.update_point_3d_errors()
    between = (kept[:, None] != kept) & (fit > JOINED)
    joints = [(images[first], images[second]) for first, second in np.argwhere(np.triu(between))]
    return Split(sorted(sizes[sizes > 0].tolist(), reverse=True)[1:], joints)


def _support(fit: np.ndarray) -> np.ndarray:
    """How far pairs support the poses, from 0 if as many matches fit as by chance to 1 if as many as fit right poses.

    Poses that are only imprecise, as of a walk straight ahead, lie between: they do not contradict each other.
    """
    return np.clip((fit - JOINED) / (PAIR_FIT - JOINED), 0.0, 1.0)


def forget(joints: list[tuple[int, int]], database: pycolmap.Database) -> None:
    """Remove the matches of pairs of images."""
    with pycolmap.DatabaseTransaction(database):
        for first, second in joints:
            database.delete_matches(first, second)
            database.delete_two_view_geometry(first, second)


def _matches(
    model: pycolmap.Reconstruction, database: pycolmap.Database, images: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """(F, F) number of verified matches of each pair of F images, and the share of them that fits the poses."""
    at = {number: index for index, number in enumerate(images)}
    rays = {number: _rays(model, database, number) for number in images}
    total, fit = np.zeros((2, len(images), len(images)))
    for pair, geometry in zip(*database.read_two_view_geometries(), strict=True):
        first, second = pycolmap.pair_id_to_image_pair(pair)
        matches = np.asarray(geometry.inlier_matches).reshape(-1, 2)
        if not len(matches) or first not in at or second not in at:
            continue
        here, there = rays[first][matches[:, 0]], rays[second][matches[:, 1]]
        share = _fit(model, (first, second), here, there)
        for cell in ((at[first], at[second]), (at[second], at[first])):
            total[cell], fit[cell] = len(matches), share
    return total, fit


def _rays(model: pycolmap.Reconstruction, database: pycolmap.Database, number: int) -> np.ndarray:
    """(N, 2) points at depth 1 of an image's features."""
    camera = model.cameras[model.images[number].camera_id]
    return np.asarray(camera.cam_from_img(database.read_keypoints(number)[:, :2].astype(np.float64)))


def _fit(model: pycolmap.Reconstruction, pair: tuple[int, int], here: np.ndarray, there: np.ndarray) -> float:
    """Share of a pair's matches that fit its poses."""
    first, second = (model.images[number] for number in pair)
    motion = (second.cam_from_world() * first.cam_from_world().inverse()).matrix()
    focal_length = np.mean([model.cameras[image.camera_id].mean_focal_length() for image in (first, second)])
    return float(np.mean(focal_length * sampson_distances(essential_matrix(motion), here, there) < TOLERANCE))
