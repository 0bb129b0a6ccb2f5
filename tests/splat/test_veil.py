"""Gaussians beside the image that reach the camera's plane are not drawn; others beside it are."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rasterizer import Rasterizer

EngineKind = Literal["reference", "cpu", "webgpu"]
SLIGHT = Lens("opencv", (0.01, 0.0, 0.0, 0.0))


def at(position: tuple[float, float, float], size: float) -> Gaussians:
    """One white ball at a position."""
    ones = np.ones((1, 4))
    return Gaussians(np.array([position]), np.full((1, 3), np.log(size)), ones, np.full(1, 2.0), np.ones((1, 1, 3)))


@pytest.fixture(params=["reference", "cpu", "webgpu"])
def engine(request: pytest.FixtureRequest) -> EngineKind:
    if request.param == "webgpu":
        request.getfixturevalue("adapter")
    name: EngineKind = request.param
    return name


def alpha(engine: EngineKind, scene: Gaussians, lens: Lens | None = None) -> float:
    """Maximum alpha of the scene, for a camera at the origin that looks along z with a field of 90 degrees."""
    camera = Camera(40, 40, 20.0, 20.0, 20.0, 20.0, np.eye(4), *([lens] if lens else []))
    image = Rasterizer(engine).forward(scene, camera, ("alpha",), near=0.01).alpha
    assert image is not None
    return float(image.max())


def test_what_reaches_the_cameras_plane_is_no_veil(engine: EngineKind) -> None:
    assert alpha(engine, at((2.0, 0.0, 0.2), 0.5)) == 0.0


@pytest.mark.parametrize("side", [(0.6, 0.0), (-0.6, 0.0), (0.0, 0.6), (0.0, -0.6)])
def test_one_long_axis_is_enough_to_reach_the_cameras_plane(engine: EngineKind, side: tuple[float, float]) -> None:
    assert alpha(engine, at((*side, 0.2), 0.15)) > 0.1
    for axis in range(3):
        needle = at((*side, 0.2), 0.15)
        needle.log_scales[0, axis] = np.log(0.5)
        assert alpha(engine, needle) == 0.0


@pytest.mark.parametrize(("position", "size"), [((0.15, 0.0, 0.2), 0.5), ((0.6, 0.0, 0.4), 0.3)])
def test_what_is_in_the_image_or_small_is_drawn(
    engine: EngineKind, position: tuple[float, float, float], size: float
) -> None:
    assert alpha(engine, at(position, size)) > 0.1


@pytest.mark.parametrize("engine", ["reference", "cpu"])
def test_a_lens_that_bends_does_the_same(engine: EngineKind) -> None:
    assert alpha(engine, at((2.0, 0.0, 0.2), 0.5), SLIGHT) == 0.0
    assert alpha(engine, at((0.6, 0.0, 0.4), 0.3), SLIGHT) > 0.1


def test_large_gaussians_inside_the_image_are_all_drawn(engine: EngineKind) -> None:
    rng = np.random.default_rng(3)
    depth = rng.uniform(0.05, 0.5, 300)
    slopes = np.concatenate([rng.uniform(-1.0, 1.0, (298, 2)), [[1.299, -1.299], [0.0, 0.0]]])
    means = np.column_stack([slopes * depth[:, None], depth])
    scene = Gaussians(means, np.zeros((300, 3)), np.ones((300, 4)), np.full(300, -3.0), np.ones((300, 1, 3)))
    camera = Camera(40, 40, 20.0, 20.0, 20.0, 20.0, np.eye(4))
    radii = Rasterizer(engine).forward(scene, camera, ("radii",), near=0.01).radii
    assert radii is not None
    assert (radii > 0).all()
