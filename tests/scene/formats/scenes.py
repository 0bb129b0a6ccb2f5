"""Random scenes for the tests of formats, and differences between two scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.formats import read_scene
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians


def random_scene(count: int, degree: int, seed: int = 0, extent: float = 3.0, offset: float = 0.0) -> Gaussians:
    """Random Gaussians within the ranges of all formats, with centres within `extent` of `offset`."""
    rng = np.random.default_rng(seed)
    return Gaussians(
        offset + rng.uniform(-extent, extent, (count, 3)),
        rng.uniform(-9.5, 5.5, (count, 3)),
        rng.normal(size=(count, 4)) * rng.uniform(0.01, 100, (count, 1)),
        rng.normal(0, 3, count),
        np.concatenate(
            [rng.uniform(-1.7, 1.7, (count, 1, 3)), rng.uniform(-1, 1, (count, SH_COEFFICIENTS[degree] - 1, 3))], axis=1
        ),
    )


@st.composite
def scenes(draw: st.DrawFn) -> Gaussians:
    """Scenes of 1 to 600 Gaussians and any degree, large and small, near the origin and far from it."""
    extent = 10.0 ** draw(st.integers(-3, 4))
    scene = random_scene(
        draw(st.integers(1, 600)),
        draw(st.integers(0, 3)),
        draw(st.integers(0, 2**32 - 1)),
        extent,
        draw(st.sampled_from([0.0, 1.0, -30.0])) * extent,
    )
    if draw(st.booleans()):
        scene.means[:] = scene.means[0]
    if draw(st.booleans()):
        scene.opacity_logits[0], scene.opacity_logits[-1] = -np.inf, np.inf
    if draw(st.booleans()):
        scene.quaternions[0] = draw(st.sampled_from([[0, 0, 0, 0], [1, 0, 0, 0], [0, -1, 0, 0], [0.5, -0.5, 0.5, 0.5]]))
    return scene


def turns_between(first: Gaussians, second: Gaussians) -> np.ndarray:
    """(N,) angles in degrees between the Gaussians' rotations; quaternions of length 0 count as the identity."""
    one, other = (_unit(scene.quaternions.astype(np.float64)) for scene in (first, second))
    chord = np.minimum(np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1))
    return np.degrees(4 * np.arcsin(np.clip(chord / 2, 0, 1)))


def _unit(quaternions: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.where(lengths > 0, quaternions / np.where(lengths > 0, lengths, 1), [1, 0, 0, 0])


def covariances(scene: Gaussians) -> np.ndarray:
    """(N, 3, 3) covariances, the visible effect of scales and rotations."""
    axes = rotation_matrices(_unit(scene.quaternions.astype(np.float64))) * np.exp(
        scene.log_scales.astype(np.float64)[:, None]
    )
    return axes @ np.swapaxes(axes, 1, 2)


def opacity_error(first: Gaussians, second: Gaussians) -> float:
    one, other = (1 / (1 + np.exp(-scene.opacity_logits.astype(np.float64))) for scene in (first, second))
    return float(np.abs(one - other).max())


def write_ply_of_degree_4(path: Path, scene: Gaussians) -> None:
    """Write a `.ply` of a scene of degree 3 with coefficients of degree 4 behind those of each channel."""
    scene.save(path)
    rows = PlyData.read(str(path), mmap=False)["vertex"].data
    rest = {f"f_rest_{24 * (i // 15) + i % 15}": rows[f"f_rest_{i}"] for i in range(45)}
    others = [name for name in rows.dtype.names or () if not name.startswith("f_rest_")]
    names = [*others, *(f"f_rest_{i}" for i in range(72))]
    table = np.full(len(rows), 9.0, [(name, "<f4") for name in names])
    for name in others:
        table[name] = rows[name]
    for name, values in rest.items():
        table[name] = values
    PlyData([PlyElement.describe(table, "vertex")], byte_order="<").write(str(path))


def load_or_refuse(path: Path) -> None:
    """Any file gives a valid scene or our own exception."""
    try:
        scene = read_scene(path)
    except PocketGSError as error:
        message = str(error)
        assert path.stem in message
        return
    assert len(scene) > 0
    assert all(np.isfinite(getattr(scene, name)).all() for name in ("means", "log_scales", "quaternions", "sh"))
