"""The `.spz` that the page saves holds what Python's own writer would have put there."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Error

from pocketgs.scene.formats.spz import encode, read_gaussians
from pocketgs.scene.gaussians import Gaussians
from static_site.given import SCENE, plain_scene

Call = Callable[..., Any]

SAVE = SCENE + "return [...new Uint8Array(await (await module.spzOf(scene)).arrayBuffer())];"


def saved(call: Call, scene: Gaussians) -> bytes:
    return bytes(call("formats/spz_writer.js", SAVE, plain_scene(scene)))


def random_scene(coefficients: int) -> Gaussians:
    """With numbers beyond what the format holds, exact halves, and rotations about an axis."""
    random = np.random.default_rng(coefficients)
    count = 600
    quaternions = random.normal(size=(count, 4))
    quaternions[:20] = np.eye(4)[random.integers(0, 4, 20)]
    scene = Gaussians(
        random.normal(0, 5, (count, 3)).astype(np.float32),
        random.normal(-4, 3, (count, 3)).astype(np.float32),
        (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).astype(np.float32),
        random.normal(0, 4, count).astype(np.float32),
        random.normal(0, 0.6, (count, coefficients, 3)).astype(np.float32),
    )
    scene.log_scales[:50] = (random.integers(0, 255, (50, 3)) + 0.5) / 16 - 10
    return scene


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_the_same_bytes_as_pythons_writer(call: Call, tmp_path: Path, coefficients: int) -> None:
    scene = random_scene(coefficients)
    packed = saved(call, scene)
    found, expected = (np.frombuffer(gzip.decompress(file), np.uint8) for file in (packed, encode(scene, version=3)))
    np.testing.assert_array_equal(found[:16], expected[:16])
    assert np.mean(found != expected) < 1e-4
    (tmp_path / "scene.spz").write_bytes(packed)
    read = read_gaussians(tmp_path / "scene.spz")
    np.testing.assert_allclose(read.means, scene.means, atol=2e-5)


@pytest.mark.parametrize(("value", "words"), [(np.nan, "numbers that are not finite"), (1e9, "a coordinate exceeds")])
def test_what_the_format_cannot_hold(call: Call, value: float, words: str) -> None:
    scene = random_scene(1)
    scene.means[3, 1] = value
    with pytest.raises(Error, match=words):
        saved(call, scene)
