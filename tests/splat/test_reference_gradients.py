"""The reference's analytic gradients against finite differences, in float64."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.spherical_harmonics import basis, basis_gradient
from pocketgs.splat.reference import project as reference_project
from pocketgs.splat.reference import rasterize as reference_rasterize
from pocketgs.splat.reference.adam import rotate
from pocketgs.splat.reference.loss import photometric_loss, regularise, ssim
from pocketgs.splat.reference.project import project, project_backward
from pocketgs.splat.reference.rasterize import rasterize, rasterize_backward
from pocketgs.splat.reference.scene import Scene, SceneGradient
from pocketgs.splat.settings import LossSettings

STEP = 1e-6
BACKGROUND = np.array([0.2, 0.5, 0.8])


@pytest.fixture(autouse=True)
def _no_cutoff(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loss jumps where a contribution crosses 1/255; finite differences must not cross a jump."""
    for module in (reference_project, reference_rasterize):
        monkeypatch.setattr(module, "ALPHA_MIN", 1e-12)


def loss_of(scene: Scene, camera: Camera, weights: np.ndarray) -> float:
    raster = rasterize(project(scene, camera), camera, BACKGROUND)
    return float(np.sum(raster.image * weights))


def gradient_of(scene: Scene, camera: Camera, weights: np.ndarray) -> SceneGradient:
    projection = project(scene, camera)
    raster = rasterize(projection, camera, BACKGROUND)
    return project_backward(scene, camera, projection, rasterize_backward(projection, camera, raster, weights))


def numeric(scene: Scene, group: str, index: tuple[int, ...], loss: Callable[[Scene], float]) -> float:
    values = []
    for sign in (1.0, -1.0):
        moved = Scene(
            *(getattr(scene, f).copy() for f in ("means", "log_scales", "quaternions", "opacity_logits", "sh"))
        )
        if group == "rotations":
            tangent = np.zeros((len(scene.means), 3))
            tangent[index] = sign * STEP
            moved.quaternions = rotate(scene.quaternions, tangent)
        else:
            getattr(moved, group)[index] += sign * STEP
        values.append(loss(moved))
    return (values[0] - values[1]) / (2 * STEP)


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
def test_gradient_of_an_image(camera: Camera, make_gaussians: Callable[..., Gaussians], sh_degree: int) -> None:
    scene = Scene.of(make_gaussians(count=7, sh_degree=sh_degree, seed=sh_degree, size=0.25))
    weights = np.random.default_rng(5).normal(size=(camera.height, camera.width, 3))
    gradient = gradient_of(scene, camera, weights)
    for group in ("means", "log_scales", "rotations", "opacity_logits", "sh"):
        analytic = getattr(gradient, group)
        scale = np.abs(analytic).max()
        assert scale > 0
        for index in np.ndindex(analytic.shape):
            expected = numeric(scene, group, index, lambda moved: loss_of(moved, camera, weights))
            assert abs(analytic[index] - expected) < 2e-6 * scale + 1e-6 * abs(expected), (group, index)


def test_gradient_where_the_jacobian_is_clamped(camera: Camera, make_gaussians: Callable[..., Gaussians]) -> None:
    scene = Scene.of(make_gaussians(count=4, sh_degree=0, size=0.8))
    scene.means[:, 0] = [-3.4, 3.6, 0.2, -0.3]
    scene.means[:, 1] = [0.1, -0.2, 2.9, -3.1]
    weights = np.random.default_rng(6).normal(size=(camera.height, camera.width, 3))
    gradient = gradient_of(scene, camera, weights)
    for index in np.ndindex(gradient.means.shape):
        expected = numeric(scene, "means", index, lambda moved: loss_of(moved, camera, weights))
        assert abs(gradient.means[index] - expected) < 1e-5 * np.abs(gradient.means).max(), index


def test_gradient_of_saturated_alpha_is_zero(camera: Camera, make_gaussians: Callable[..., Gaussians]) -> None:
    scene = Scene.of(make_gaussians(count=1, sh_degree=0, size=60.0))
    scene.opacity_logits[:] = 12.0
    gradient = gradient_of(scene, camera, np.ones((camera.height, camera.width, 3)))
    assert gradient.opacity_logits[0] == 0.0
    assert np.abs(gradient.sh).max() > 0


@pytest.mark.parametrize("photometric", ["l2", "l1-dssim"])
@pytest.mark.parametrize("masked", [False, True])
def test_gradient_of_the_loss(photometric: str, masked: bool) -> None:
    rng = np.random.default_rng(1)
    rendered, photo = rng.uniform(size=(17, 14, 3)), rng.uniform(size=(17, 14, 3))
    mask = rng.uniform(size=(17, 14)) > 0.3 if masked else None
    settings = LossSettings(photometric=photometric, dssim_weight=0.3)  # type: ignore[arg-type]
    _, gradient = photometric_loss(rendered, photo, settings, mask)
    for index in [(0, 0, 0), (8, 7, 1), (16, 13, 2), (5, 3, 0), (11, 9, 2), (2, 12, 1)]:
        values = []
        for sign in (1.0, -1.0):
            moved = rendered.copy()
            moved[index] += sign * STEP
            # Outside the mask the photograph stands still at what was rendered.
            reference = photo if mask is None else np.where(mask[..., None], photo, rendered)
            values.append(photometric_loss(moved, reference, settings)[0])
        expected = (values[0] - values[1]) / (2 * STEP)
        if mask is not None and not mask[index[:2]]:
            expected = 0.0
        assert gradient[index] == pytest.approx(expected, rel=1e-6, abs=1e-10)


def test_ssim_of_equal_images_is_one_and_flat() -> None:
    image = np.random.default_rng(2).uniform(size=(20, 15, 3))
    value, gradient = ssim(image, image)
    assert value == pytest.approx(1.0, abs=1e-12)
    assert np.abs(gradient).max() < 1e-12


def test_gradient_of_the_regularisers(make_gaussians: Callable[..., Gaussians]) -> None:
    scene = Scene.of(make_gaussians(count=5, sh_degree=0))
    settings = LossSettings(scale_weight=0.3, opacity_weight=0.7)

    def zeros() -> SceneGradient:
        empty = np.array([], dtype=int)
        shapes = ((3,), (3,), (3,), (), (1, 3))
        return SceneGradient.scatter(5, empty, *(np.zeros((0, *shape)) for shape in shapes))

    gradient = zeros()
    regularise(scene, settings, gradient)
    for group in ("log_scales", "opacity_logits"):
        analytic = getattr(gradient, group)
        for index in np.ndindex(analytic.shape):
            expected = numeric(scene, group, index, lambda moved: regularise(moved, settings, zeros()))
            assert analytic[index] == pytest.approx(expected, rel=1e-6)


def test_spherical_harmonics_are_orthonormal_and_their_gradient_right() -> None:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    values = basis(directions, 16)
    np.testing.assert_allclose(4 * np.pi * values.T @ values / len(values), np.eye(16), atol=0.03)
    few = directions[:5]
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = STEP
        expected = (basis(few + step, 16) - basis(few - step, 16)) / (2 * STEP)
        np.testing.assert_allclose(basis_gradient(few, 16)[:, :, axis], expected, atol=1e-8)
