"""The `.pgs` that the page saves is the file that Python writes with the same coding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Error

from pocketgs.scene.formats.pgs import decode, encode
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.site.settings import PGS_CODING
from scene.formats.scenes import random_scene
from static_site.given import SCENE, plain_scene

Call = Callable[..., Any]

SAVE = (
    SCENE
    + """
    const shares = [];
    const blob = await module.pgsOf(scene, settings.pgs, async (share) => shares.push(share));
    return [shares, [...new Uint8Array(await blob.arrayBuffer())]];
"""
)


def saved(call: Call, scene: Gaussians) -> bytes:
    shares, content = call("formats/pgs_writer.js", SAVE, plain_scene(scene))
    assert shares == sorted(shares)
    assert shares[-1] == 1
    return bytes(content)


@pytest.mark.parametrize(
    ("count", "degree", "extent", "offset"),
    [(1, 0, 1.0, 0.0), (700, 0, 3.0, 0.0), (900, 1, 1e4, -3e4), (5000, 2, 1.0, 0.0), (300, 3, 1e-3, 1.0)],
)
def test_the_same_file_as_pythons(call: Call, count: int, degree: int, extent: float, offset: float) -> None:
    scene = random_scene(count, degree, seed=count, extent=extent, offset=offset)
    assert saved(call, scene) == encode(scene, PGS_CODING)


def test_what_many_gaussians_share(call: Call) -> None:
    """The page writes no codebook where Python would, but the same numbers."""
    scene = random_scene(400, 2)
    scene.means[:200] = scene.means[0]
    scene.sh[:, 1:] = 0
    found, expected = decode(saved(call, scene)), decode(encode(scene, PGS_CODING))
    for name in PARAMETERS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_numbers_that_are_not_finite(call: Call) -> None:
    scene = random_scene(9, 1)
    scene.sh[3, 2, 1] = np.inf
    with pytest.raises(Error, match="numbers that are not finite"):
        saved(call, scene)
