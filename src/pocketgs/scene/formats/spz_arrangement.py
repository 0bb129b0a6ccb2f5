"""Equivalent arrangements of the same Gaussians that compress better.

A Gaussian looks the same however its axes are ordered and oriented: 24 rotations, each with its order of scales,
describe the same ellipsoid. And a scene looks the same in any order.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product

import numpy as np

from pocketgs.geometry.quaternions import composed, unit
from pocketgs.scene.formats.spz_attributes import pack_rotations
from pocketgs.scene.formats.spz_precision import Precision
from pocketgs.scene.gaussians import Gaussians

_CONJUGATE = np.array([1, -1, -1, -1])


def rearranged(gaussians: Gaussians, precision: Precision) -> Gaussians:
    """The same scene with fewer distinct rotations, equal ones together.

    No other order saves as much: sorting by a coordinate shrinks the coordinates, but the rotations grow more.
    """
    turned = with_least_turns(gaussians)
    return turned.select(np.argsort(pack_rotations(turned.quaternions, precision.rotation), kind="stable"))


def with_least_turns(gaussians: Gaussians) -> Gaussians:
    """The same ellipsoids, with axes named so that the rotation angle is smallest, 62.8 degrees at most."""
    quaternions = unit(gaussians.quaternions)
    # cos(angle / 2) of each: the component w of the product.
    cosines = quaternions @ (RENAMINGS * _CONJUGATE).T
    least = np.abs(cosines).argmax(axis=1)
    turned = composed(quaternions, RENAMINGS[least])
    scales = np.take_along_axis(gaussians.log_scales, AXES[least], axis=1)
    return replace(gaussians, quaternions=turned * np.where(turned[:, :1] < 0, -1.0, 1.0), log_scales=scales)


def _renamings() -> np.ndarray:
    """(24, 4) rotations that map a cube onto itself."""
    basis = np.eye(4)
    edges = [basis[i] + sign * basis[j] for i, j in combinations(range(4), 2) for sign in (1, -1)]
    corners = [np.array([1, *signs]) for signs in product((1, -1), repeat=3)]
    return unit(np.array([*basis, *edges, *corners]))


def _axes_of(quaternions: np.ndarray) -> np.ndarray:
    """(R, 3) index of the old axis that each new axis lies along."""
    along = [composed(composed(quaternions, axis), quaternions * _CONJUGATE) for axis in np.eye(4)[1:]]
    return np.abs(np.stack(along, axis=1))[..., 1:].argmax(axis=2)


RENAMINGS = _renamings()
AXES = _axes_of(RENAMINGS)
