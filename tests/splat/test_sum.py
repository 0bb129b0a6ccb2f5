"""The compositor "sum": gradients, agreement of the engines, and that no order matters."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from pocketgs import Rasterizer
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.rasterizer import Raster, RasterGradient
from pocketgs.splat.reference.scene import Scene
from splat.training_step import camera_in_front, sheets

MakeGaussians = Callable[..., Gaussians]
OUTPUTS: Any = ("rgb", "alpha", "normals", "features")
GROUPS = ("means", "log_scales", "rotations", "opacity_logits", "sh", "features")


@cache
def shared(engine: Any) -> Rasterizer:
    return Rasterizer(engine, compositor="sum")


def drawn(engine: Any, scene: Any, camera: Camera, channels: int = 5) -> tuple[Raster, RasterGradient]:
    features = np.random.default_rng(2).normal(size=(len(scene.means), channels))
    raster = shared(engine).forward(scene, camera, OUTPUTS, features=features)
    rng = np.random.default_rng(5)
    weights = {name: rng.normal(size=getattr(raster, name).shape) for name in OUTPUTS}
    return raster, shared(engine).backward(raster, **weights, absolute=True)


def test_gradients_of_the_reference(camera: Camera, make_gaussians: MakeGaussians) -> None:
    scene = Scene.of(make_gaussians(count=5, sh_degree=1, seed=3, size=0.3))
    raster, gradient = drawn("reference", scene, camera)
    rng = np.random.default_rng(5)
    weights = {name: rng.normal(size=getattr(raster, name).shape) for name in OUTPUTS}

    def loss(moved: Scene) -> float:
        seen, _ = drawn("reference", moved, camera)
        return float(sum(np.sum(getattr(seen, name) * weight) for name, weight in weights.items()))

    for name in ("means", "log_scales", "opacity_logits", "sh"):
        analytic = getattr(gradient, name)
        indices = list(np.ndindex(analytic.shape))
        for pick in np.random.default_rng(9).permutation(len(indices))[:6]:
            values = []
            for step in (1e-6, -1e-6):
                moved = Scene(*(getattr(scene, each).copy() for each in PARAMETERS))
                getattr(moved, name)[indices[pick]] += step
                values.append(loss(moved))
            expected = (values[0] - values[1]) / 2e-6
            assert abs(analytic[indices[pick]] - expected) < 1e-5 * np.abs(analytic).max() + 1e-6, name


@pytest.mark.parametrize(("count", "channels"), [(60, 1), (400, 7)])
def test_engines_agree_with_the_reference(
    engine: str, camera: Camera, make_gaussians: MakeGaussians, count: int, channels: int
) -> None:
    scene = make_gaussians(count=count, sh_degree=1, seed=count)
    (found, d_found), (expected, d_expected) = (drawn(one, scene, camera, channels) for one in (engine, "reference"))
    for name in OUTPUTS:
        one, other = getattr(found, name), getattr(expected, name)
        assert np.mean(np.abs(one - other) > 2e-3 * np.abs(other).max()) < 0.01, name
    for name in (*GROUPS, "centres", "absolute_centres"):
        one, other = getattr(d_found, name), getattr(d_expected, name)
        assert np.quantile(np.abs(one - other), 0.99) < 5e-3 * np.abs(other).max(), name


def test_a_splat_comes_into_a_pixel_little_by_little(engine: str) -> None:
    """Opacities around the cut, at a splat's centre: sorted images jump from 0 to 1/255 there."""
    camera, images = camera_in_front(16, 16, 16.0), []
    for opacity in np.linspace(0.9, 1.1, 21) / 255.0:
        logit = np.log(opacity / (1.0 - opacity))
        scene = Gaussians(np.zeros((1, 3)), np.full((1, 3), 2.0), [[1.0, 0, 0, 0]], [logit], np.zeros((1, 1, 3)))
        raster = shared(engine).forward(scene, camera, ("alpha", "features"), features=np.full((1, 1), 1e6))
        assert raster.features is not None
        images.append(raster.features[8, 8, 0])
    assert images[0] == 0.0
    assert images[-1] == pytest.approx(1e6 * 0.1 / 255.0, rel=0.02)
    assert np.diff(images).max() < 1.1e6 * 0.01 / 255.0


def test_no_order_matters(engine: str, camera: Camera, make_gaussians: MakeGaussians) -> None:
    """The scene and its reverse differ by rounding; with "over" only sorting brings that about."""
    scene = make_gaussians(count=500, sh_degree=1, size=0.1)
    features = np.random.default_rng(2).normal(size=(500, 2))
    one = shared(engine).forward(scene, camera, OUTPUTS, features=features)
    backwards = np.arange(500)[::-1]
    other = shared(engine).forward(scene.select(backwards), camera, OUTPUTS, features=features[backwards])
    for name in OUTPUTS:
        scale = np.abs(getattr(one, name)).max()
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=3e-6 * scale, err_msg=name)


def test_same_bits_on_any_number_of_threads(make_gaussians: MakeGaussians) -> None:
    camera, scene = camera_in_front(90, 70, 90.0), make_gaussians(count=1500, sh_degree=1, size=0.06)
    features = np.random.default_rng(2).normal(size=(1500, 4))
    results = []
    for threads in (1, 2):
        rasterizer = Rasterizer("cpu", threads, compositor="sum")
        raster = rasterizer.forward(scene, camera, ("features", "alpha"), features=features)
        gradient = rasterizer.backward(raster, features=raster.features, alpha=raster.alpha)
        results.append((raster.features, raster.alpha, *(getattr(gradient, name) for name in GROUPS)))
    for one, other in zip(*results, strict=True):
        assert one.tobytes() == other.tobytes()


def test_nothing_is_ever_full(engine: str, make_gaussians: MakeGaussians) -> None:
    """A hundred opaque splats on one another all count, where T has long vanished."""
    scene = make_gaussians(count=100, sh_degree=0, size=0.5)
    scene.means[:] = (0.0, 0.0, 0.0)
    scene.opacity_logits[:] = 9.0
    camera = camera_in_front(16, 16, 16.0)
    raster = shared(engine).forward(scene, camera, ("alpha", "features"), features=np.ones((100, 1)))
    assert raster.features is not None
    assert raster.features[8, 8, 0] > 80.0
    gradient = shared(engine).backward(raster, features=np.ones_like(raster.features), alpha=raster.alpha)
    assert np.all(np.isfinite(gradient.means))


def test_a_gaussian_as_opaque_as_can_be_has_no_gradient_of_its_shape(engine: str) -> None:
    raster = shared(engine).forward(sheets(np.array([0.999])), camera_in_front(8, 16, 16.0), ("rgb", "alpha"))
    np.testing.assert_allclose(raster.alpha, 0.99 - 1.0 / 255.0, atol=1e-6)
    gradient = shared(engine).backward(raster, rgb=np.ones((16, 8, 3)), alpha=np.ones((16, 8)))
    for group in ("means", "log_scales", "rotations", "opacity_logits"):
        assert not getattr(gradient, group).any(), group
    assert gradient.sh.all()


def test_gradients_of_opaque_splats_are_those_of_the_reference(
    engine: str, camera: Camera, make_gaussians: MakeGaussians
) -> None:
    scene = make_gaussians(count=12, sh_degree=0, size=0.3)
    scene.opacity_logits += 3.0
    gradients = []
    for one in (engine, "reference"):
        raster = shared(one).forward(scene, camera, ("alpha",))
        gradients.append(shared(one).backward(raster, alpha=np.ones((camera.height, camera.width))))
    for name in ("means", "log_scales", "rotations", "opacity_logits"):
        found, expected = (getattr(gradient, name) for gradient in gradients)
        np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max(), err_msg=name)


def test_mistakes_are_named(camera: Camera, make_gaussians: MakeGaussians) -> None:
    with pytest.raises(PocketGSError, match="'under', expected over or sum"):
        Rasterizer("cpu", compositor="under")  # type: ignore[arg-type]
    with pytest.raises(PocketGSError, match="'depth', which needs the compositor over"):
        shared("cpu").forward(make_gaussians(count=4), camera, ("rgb", "depth"))
