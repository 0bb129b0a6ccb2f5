"""Colours of clouds, whatever the type of the numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pocketgs.capture.decoding.cloud_file import MOST_POINTS, read_cloud
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound

COLOURS = np.array([[0.0, 0.2, 0.4], [0.6, 0.8, 1.0]])


@pytest.mark.parametrize(
    ("kind", "full"), [("u1", 255), ("u2", 65535), ("u2", 255), ("i4", 255), ("f4", 1), ("f8", 1), ("f4", 255)]
)
def test_colours(tmp_path: Path, kind: str, full: int) -> None:
    types = [(axis, "f4") for axis in "xyz"] + [(name, kind) for name in ("red", "green", "blue")]
    vertices = np.zeros(2, types)
    for name, column in zip(("red", "green", "blue"), (COLOURS * full).T, strict=True):
        vertices[name] = column if kind.startswith("f") else np.round(column)
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(tmp_path / "cloud.ply"))
    cloud = read_cloud(tmp_path / "cloud.ply")
    assert cloud is not None
    np.testing.assert_allclose(cloud.colours, COLOURS, atol=1e-6)


def written_scan(path: Path, count: int) -> np.ndarray:
    """Write a cloud without colours, and return its (count, 3) positions."""
    positions = np.random.default_rng(0).random((count, 3), np.float32)
    vertices = positions.view([(axis, "f4") for axis in "xyz"])[:, 0]
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))
    return positions


def test_of_large_clouds_some_points_are_read(tmp_path: Path) -> None:
    positions = written_scan(tmp_path / "scan.ply", MOST_POINTS + 1)
    cloud = read_cloud(tmp_path / "scan.ply")
    assert cloud is not None
    np.testing.assert_array_equal(cloud.positions, positions[::2])


def test_clouds_keep_to_the_memory_bound(tmp_path: Path) -> None:
    written_scan(tmp_path / "scan.ply", 200_000)
    with memory_bound(30):
        assert read_cloud(tmp_path / "scan.ply") is not None
    with memory_bound(20), pytest.raises(PocketGSError, match=r"scan\.ply: a cloud of 200,000 points would take"):
        read_cloud(tmp_path / "scan.ply")


def test_meshes_keep_to_the_memory_bound(tmp_path: Path) -> None:
    faces = np.zeros(100_000, [("vertex_indices", "i4", (3,))])
    vertices = np.zeros(1, [(axis, "f4") for axis in "xyz"])
    elements = [PlyElement.describe(vertices, "vertex"), PlyElement.describe(faces, "face")]
    PlyData(elements, byte_order="<").write(str(tmp_path / "mesh.ply"))
    assert read_cloud(tmp_path / "mesh.ply") is not None
    with memory_bound(20), pytest.raises(PocketGSError, match=r"mesh\.ply: its lists would take"):
        read_cloud(tmp_path / "mesh.ply")
