"""Colours of clouds, whatever the type of the numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pocketgs.capture.cloud_file import read_cloud

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
