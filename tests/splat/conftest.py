"""Small hand-made scenes and views."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.gaussians import SH_COEFFICIENTS, SH_DC, Gaussians


@pytest.fixture(params=["cpu", "webgpu"])
def engine(request: pytest.FixtureRequest) -> str:
    """The name of an engine; a test that takes others too states them with `indirect=True`."""
    if request.param == "webgpu":
        request.getfixturevalue("adapter")
    return str(request.param)


@pytest.fixture
def camera() -> Camera:
    """A 37 x 29 view from in front of the origin, slightly rotated, with an off-centre principal point."""
    pose = look_at(np.array([0.3, -0.2, -4.0]), np.array([0.0, 0.1, 0.0]), np.array([0.05, -1.0, 0.0]))
    return Camera(37, 29, 40.0, 42.0, 18.1, 14.9, pose)


@pytest.fixture
def make_gaussians() -> Callable[..., Gaussians]:
    """A function that scatters Gaussians of all shapes in front of `camera`."""

    def make(count: int = 12, sh_degree: int = 3, seed: int = 0, size: float = 0.15) -> Gaussians:
        rng = np.random.default_rng(seed)
        sh = rng.normal(0.0, 0.12, (count, SH_COEFFICIENTS[sh_degree], 3))
        sh[:, 0] = (rng.uniform(0.1, 0.9, (count, 3)) - 0.5) / SH_DC
        means = rng.uniform(-1.0, 1.0, (count, 3))
        # Depths that stay in order under the small steps of finite differences.
        means[:, 2] = np.linspace(-1.5, 1.5, count)[rng.permutation(count)]
        return Gaussians(
            means,
            np.log(size * np.exp(rng.normal(0.0, 0.5, (count, 3)))),
            rng.normal(0.0, 1.0, (count, 4)),
            rng.uniform(-2.0, 2.0, count),
            sh,
        )

    return make
