"""The optimiser for custom code."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pocketgs import Adam, Camera, Gaussians, PocketGSError, Rasterizer
from pocketgs.splat.rasterizer import RasterGradient
from pocketgs.splat.settings import LearningRates

RATES = LearningRates(1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3)

MakeGaussians = Callable[..., Gaussians]


def gradient_of(gaussians: Gaussians, camera: Camera) -> RasterGradient:
    rasterizer = Rasterizer()
    seen = rasterizer.forward(gaussians, camera)
    return rasterizer.backward(seen, rgb=np.ones((camera.height, camera.width, 3)))


def test_an_empty_scene_stays_empty(camera: Camera, make_gaussians: MakeGaussians) -> None:
    adam = Adam(make_gaussians(count=0))
    adam.step(gradient_of(make_gaussians(count=0), camera), RATES)
    assert len(adam.scene) == 0


@pytest.mark.parametrize(("count", "sh_degree"), [(5, 3), (4, 1)])
def test_gradients_of_another_scene_are_refused(
    camera: Camera, make_gaussians: MakeGaussians, count: int, sh_degree: int
) -> None:
    scene = make_gaussians(count=4)
    adam = Adam(scene)
    with pytest.raises(PocketGSError, match=r"adam: found gradients of .*, expected \[\(4, 3\)"):
        adam.step(gradient_of(make_gaussians(count=count, sh_degree=sh_degree), camera), RATES)
    np.testing.assert_array_equal(adam.scene.means, scene.means)
