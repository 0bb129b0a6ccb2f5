"""`.splat` byte by byte."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats import splat
from scene.formats.scenes import random_scene

RECORD = struct.Struct("<6f8B")


def read(tmp_path: Path, *records: bytes) -> list[list[float]]:
    (tmp_path / "scene.splat").write_bytes(b"".join(records))
    scene = splat.read_gaussians(tmp_path / "scene.splat")
    return [scene.means.tolist(), scene.scales.tolist(), scene.quaternions.tolist()]


def test_record(tmp_path: Path) -> None:
    means, scales, quaternions = read(
        tmp_path, RECORD.pack(1, -2, 3, 0.5, 1, 2, 255, 128, 0, 51, 128, 128, 0, 128), RECORD.pack(*[1] * 6, *[128] * 8)
    )
    assert means == [[1, -2, 3], [1, 1, 1]]
    np.testing.assert_allclose(scales, [[0.5, 1, 2], [1, 1, 1]], rtol=1e-6)
    # No rotation at all is written by some as four zeros.
    assert quaternions == [[0, 0, -1, 0], [1, 0, 0, 0]]


def test_what_is_written(tmp_path: Path) -> None:
    scene = random_scene(2, 1)
    scene.means[:] = [[1, 2, 3], [4, 5, 6]]
    scene.log_scales[:] = [[-3, -3, -3], [0, 0, 0]]
    scene.quaternions[:] = [[0, 0, 0, 2], [-3, 0, 0, 0]]
    scene.opacity_logits[:] = [np.inf, 0]
    scene.sh[:, 0] = 0
    splat.write_gaussians(tmp_path / "scene.splat", scene)
    large, small = RECORD.iter_unpack((tmp_path / "scene.splat").read_bytes())
    assert large == (4, 5, 6, 1, 1, 1, 128, 128, 128, 128, 0, 128, 128, 128)
    assert small[:3] + small[6:] == (1, 2, 3, 128, 128, 128, 255, 128, 128, 128, 255)


def test_scale_of_nothing(tmp_path: Path) -> None:
    """A Gaussian without extent along an axis is flat, not broken."""
    _, scales, _ = read(tmp_path, RECORD.pack(0, 0, 0, 0, 1, 1, *[128] * 8))
    assert 0 < scales[0][0] < 1e-37


@pytest.mark.parametrize(
    ("records", "message"),
    [
        (b"", "0 bytes, expected a multiple of 32"),
        (bytes(33), "33 bytes, expected a multiple of 32"),
        (RECORD.pack(0, 0, 0, -1, 1, 1, *[128] * 8), "negative scales"),
        (RECORD.pack(np.nan, 0, 0, 1, 1, 1, *[128] * 8), "1 of 1 Gaussians hold NaN"),
        (RECORD.pack(0, 0, 0, 1, np.inf, 1, *[128] * 8), "1 of 1 Gaussians hold NaN or infinity"),
    ],
)
def test_broken(tmp_path: Path, records: bytes, message: str) -> None:
    with pytest.raises(PocketGSError, match=f"scene.splat.*{message}"):
        read(tmp_path, records)
