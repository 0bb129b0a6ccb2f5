"""The `.ply` layout of the reference 3DGS implementation, which every splat viewer reads.

One `vertex` element of float32 properties: x y z, nx ny nz (zero), f_dc_0..2 (SH degree 0 of R, G, B), f_rest_0.. (the
higher coefficients, channel by channel), opacity (logit), scale_0..2 (natural logarithm), rot_0..3 (w x y z).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.ply_file import read_comments, read_vertices
from pocketgs.scene.formats import antialiased
from pocketgs.scene.formats.activations import finite_log_scales
from pocketgs.scene.formats.checks import require_any, require_room, warn_of_degree_4
from pocketgs.scene.formats.coarseness import warn_if_far
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians

# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (100, 38)

DEGREE_4 = 25
"""Coefficients of spherical harmonics of degree 4, with those of lower degrees."""

FLATNESS = math.log(1e-3)
"""Logarithm of the thickness of a Gaussian that has two axes, relative to the smaller one: flat to the eye, and a
variance that float32 can still tell from the others."""


def _property_names(rest: int) -> list[str]:
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(rest)]
    return [*names, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def write_gaussians(
    path: Path,
    gaussians: Gaussians,
    properties: Mapping[str, np.ndarray] = MappingProxyType({}),
    comments: Sequence[str] = (),
) -> None:
    """Write a scene atomically.

    Args:
        path: of the file.
        gaussians: the scene.
        properties: more properties of the Gaussians by name, (N,) each.
        comments: of the header, one line each.

    Raises:
        PocketGSError: the scene is empty, or the file cannot be written.
    """
    count = len(gaussians)
    require_any(path, count)
    rest = np.swapaxes(gaussians.sh[:, 1:], 1, 2).reshape(count, 3 * (gaussians.sh.shape[1] - 1))
    columns = [
        gaussians.means,
        np.zeros((count, 3), np.float32),
        gaussians.sh[:, 0],
        rest,
        gaussians.opacity_logits[:, None],
        gaussians.log_scales,
        gaussians.quaternions,
        *(values[:, None] for values in properties.values()),
    ]
    table = np.concatenate(columns, axis=1).astype("<f4")
    names = [*_property_names(rest.shape[1]), *properties]
    vertices = table.view([(name, "<f4") for name in names]).reshape(count)
    content = PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<", comments=list(comments))
    with replacing(path) as partial:
        content.write(str(partial))


def read_gaussians(path: Path) -> Gaussians:
    """Read a scene. Normals and properties outside the layout are ignored, with a warning harmonics of degree 4.

    The Gaussians of 2DGS have two axes: they become thin discs. A thickness of 0 becomes the smallest of float32.

    Raises:
        PocketGSError: the file is missing, broken or empty, or lacks a property of the layout.
    """
    data = read_vertices(path)
    # List properties become object arrays.
    available = {name for name in data.dtype.names or () if data.dtype[name].kind != "O"}
    rest = sum(name.startswith("f_rest_") for name in available)
    missing = [name for name in _property_names(rest) if name not in available and name not in ("nx", "ny", "nz")]
    is_flat = missing == ["scale_2"]
    if missing and not is_flat:
        raise PocketGSError(f"{path}: holds no Gaussians: vertex property {missing[0]!r} is missing or not a number")
    if 1 + rest // 3 not in (*SH_COEFFICIENTS, DEGREE_4) or rest % 3:
        raise PocketGSError(f"{path}: {rest} f_rest properties, expected 0, 9, 24, 45 or 72 (SH degree 0 to 4)")

    require_any(path, len(data))
    require_room(path, len(data), 1 + rest // 3, READING)
    coefficients = min(1 + rest // 3, SH_COEFFICIENTS[-1])
    if 1 + rest // 3 > coefficients:
        warn_of_degree_4(path)

    def stack(*names: str) -> np.ndarray:
        return np.stack([np.asarray(data[name], dtype=np.float32) for name in names], axis=1)

    log_scales = stack("scale_0", "scale_1") if is_flat else stack("scale_0", "scale_1", "scale_2")
    if is_flat:
        log_scales = np.column_stack([log_scales, log_scales.min(axis=1) + np.float32(FLATNESS)])
    sh = np.empty((len(data), coefficients, 3), np.float32)
    sh[:, 0] = stack("f_dc_0", "f_dc_1", "f_dc_2")
    if rest:
        by_channel = stack(*(f"f_rest_{i}" for i in range(rest))).reshape(len(data), 3, rest // 3)
        sh[:, 1:] = np.swapaxes(by_channel[:, :, : coefficients - 1], 1, 2)
    antialiased.warn_if(antialiased.is_marked(read_comments(path)), path)
    gaussians = Gaussians(
        stack("x", "y", "z"),
        finite_log_scales(log_scales),
        stack("rot_0", "rot_1", "rot_2", "rot_3"),
        stack("opacity")[:, 0],
        sh,
    )
    warn_if_far(path, gaussians, [data[name] for name in ("x", "y", "z")])
    return gaussians
