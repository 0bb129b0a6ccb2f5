"""Relocalising a single photograph in a structure, for views that other criteria than geometry call into question."""

from __future__ import annotations

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.pairs import likeness
from pocketgs.prior.features.sift import detect, match
from pocketgs.prior.features.two_view import VERIFICATION, agreeing
from pocketgs.prior.poses.relocalise import pose_from_points
from pocketgs.prior.poses.structure import Structure

FEATURES = 2000
MAX_SIMILAR = 12
"""Number of most similar views to match the photograph with, regardless of its stated pose."""


def placed_again(frame: Frame, structure: Structure) -> Camera | None:
    """The frame's camera, relocalised from its photograph alone, or None if that is not possible.

    The frame's own pose and its own observations in the structure are ignored.

    Args:
        frame: with its intrinsics.
        structure: points, and the features of other frames that see them.
    """
    own = detect(frame, FEATURES)
    others = [view for view, name in enumerate(structure.names) if name != frame.name]
    alike = likeness([own, *(structure.landmarks[view][0] for view in others)])[0, 1:]
    pixels, points = [np.zeros((0, 2))], [np.zeros((0, 3))]
    for place in np.argsort(-alike, kind="stable")[:MAX_SIMILAR].tolist():
        view = others[place]
        theirs, point = structure.landmarks[view]
        found = match(own, theirs)
        here, there = own.pixels[found[:, 0]], theirs.pixels[found[:, 1]]
        good = agreeing(frame.camera, structure.cameras[view], here, there, VERIFICATION * max(own.grain, theirs.grain))
        pixels.append(here[good])
        points.append(structure.points[point[found[good, 1]]])
    both = np.unique(np.concatenate([np.concatenate(points), np.concatenate(pixels)], axis=1), axis=0)
    return pose_from_points(frame.camera, both[:, :3], both[:, 3:], 2 * structure.tolerance)
