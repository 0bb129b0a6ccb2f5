"""Splatting through lenses and with anti-aliasing: the reference's gradients, the engines against it, culling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs import Rasterizer
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.geometry.lens import Lens, largest_angle, least_radii
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.cpu.clusters import Clusters
from pocketgs.splat.cpu.layout import CLUSTER, View
from pocketgs.splat.cpu.lenses.lens import kernel_lens
from pocketgs.splat.engine import EngineName, EngineOptions
from pocketgs.splat.lens_bounds import least_radius_per_radian, stretch
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.rasterizer import Raster, RasterGradient
from pocketgs.splat.reference import project as reference_project
from pocketgs.splat.reference import rasterize as reference_rasterize
from pocketgs.splat.reference.lenses import linearised
from pocketgs.splat.reference.project import project
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.slope_limits import _through as slope_limits_through
from pocketgs.splat.slope_limits import slope_limits
from splat.test_clusters import a_camera, around
from splat.test_rasterizer import moved
from splat.training_step import BACKGROUND, RATES, begin, camera_in_front, columns, photograph, reference_step

MakeGaussians = Callable[..., Gaussians]

LENSES = {
    "pinhole": Lens(),
    "opencv": Lens("opencv", (-0.2, 0.05, 0.003, -0.004, 0.02, 0.03, 0.01, 0.002, 0.004, -0.003, 0.002, 0.001)),
    "fisheye": Lens("fisheye", (0.05, -0.02, 0.004, -0.001)),
    "orthographic": Lens("orthographic"),
}
BENT = [name for name in LENSES if name != "pinhole"]
CASES = [*((name, False) for name in BENT), ("pinhole", True), ("fisheye", True)]
AGREEING = [(engine, *case) for engine in ("cpu", "webgpu") for case in CASES]
OUTPUTS = ("rgb", "alpha", "depth", "features")
FEATURES = 3
STEP = 1e-6


def through(camera: Camera, name: str) -> Camera:
    """The camera with a lens. A fisheye's field is wide enough to see points beside the camera."""
    focal = {"fisheye": 0.3, "orthographic": 0.3}.get(name, 1.0)
    return replace(camera, lens=LENSES[name], fx=focal * camera.fx, fy=focal * camera.fy)


def a_scene(make_gaussians: MakeGaussians, name: str, count: int, size: float) -> Gaussians:
    """Gaussians in front of the camera; for a fisheye also close to the axis, beside the camera and behind it."""
    scene = make_gaussians(count=count, sh_degree=1, size=size, seed=3)
    if name == "fisheye":
        rng = np.random.default_rng(4)
        scene.means[::3] = rng.uniform([-2.5, -2.5, -5.0], [2.5, 2.5, -4.2], scene.means[::3].shape)
        scene.means[0] = (0.3, -0.2, -2.5)
    return scene


def weights(seed: int, raster: Raster) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    found = {name: rng.normal(size=getattr(raster, name).shape) for name in OUTPUTS}
    found["depth"] *= raster.alpha > 0.05
    return found


@pytest.mark.parametrize("name", LENSES)
def test_second_derivatives(name: str) -> None:
    camera = replace(Camera(64, 48, 40.0, 42.0, 30.0, 25.0, np.eye(4)), lens=LENSES[name])
    rng = np.random.default_rng(0)
    local = rng.normal(size=(300, 3))
    local[:, 2] += 2.5 if name != "fisheye" else 0.5
    local[:, :2] *= np.geomspace(1e-7, 1.0, 300)[:, None]
    if name != "fisheye":
        local[:, 2] = np.abs(local[:, 2]) + 0.3
    else:
        local[:200, 2] = np.abs(local[:200, 2]) + 0.1
    d_jacobian = rng.normal(size=(300, 2, 3))
    found = linearised(local, camera).backward(d_jacobian)
    for axis in range(3):
        step = STEP * np.eye(3)[axis]
        change = linearised(local + step, camera).jacobian - linearised(local - step, camera).jacobian
        expected = np.einsum("nij,nij->n", change, d_jacobian) / (2 * STEP)
        error = np.abs(found[:, axis] - expected)
        # One point in hundreds may cross the margin where J is held.
        assert np.quantile(error / (1.0 + np.abs(expected)), 0.99) < 1e-5


@pytest.mark.parametrize(("name", "antialiased"), CASES)
def test_gradients_of_the_reference(
    monkeypatch: pytest.MonkeyPatch, camera: Camera, make_gaussians: MakeGaussians, name: str, antialiased: bool
) -> None:
    for module in (reference_project, reference_rasterize):
        monkeypatch.setattr(module, "ALPHA_MIN", 1e-12)
    camera = through(camera, name)
    scene = Scene.of(a_scene(make_gaussians, name, 6, 0.1 if antialiased else 0.3))
    features = np.random.default_rng(1).normal(size=(6, FEATURES))
    rasterizer = Rasterizer("reference")

    def render(of: Scene, view: Camera) -> Raster:
        return rasterizer.forward(of, view, OUTPUTS, features=features, antialiased=antialiased)

    raster = render(scene, camera)
    given_weights = weights(5, raster)
    gradient = rasterizer.backward(raster, **given_weights, pose=True)

    def loss(of: Scene, view: Camera) -> float:
        seen = render(of, view)
        return float(sum(np.sum(getattr(seen, output) * weight) for output, weight in given_weights.items()))

    for group in ("means", "log_scales", "quaternions", "opacity_logits"):
        analytic = getattr(gradient, group)
        assert np.abs(analytic).max() > 0
        for index in list(np.ndindex(analytic.shape))[::2]:
            values = []
            for sign in (1.0, -1.0):
                arrays = {each: getattr(scene, each).copy() for each in PARAMETERS}
                arrays[group][index] += sign * STEP
                values.append(loss(Scene(**arrays), camera))
            expected = (values[0] - values[1]) / (2 * STEP)
            assert abs(analytic[index] - expected) < 2e-5 * np.abs(analytic).max() + 1e-6, (group, index)
    for k in range(6):
        twist = STEP * np.eye(6)[k]
        expected = (loss(scene, moved(camera, twist)) - loss(scene, moved(camera, -twist))) / (2 * STEP)
        assert gradient.pose[k] == pytest.approx(expected, rel=1e-5, abs=1e-5 * np.abs(gradient.pose).max())


@pytest.mark.parametrize(("engine", "name", "antialiased"), AGREEING)
def test_engines_agree_with_the_reference(
    request: pytest.FixtureRequest,
    camera: Camera,
    make_gaussians: MakeGaussians,
    engine: str,
    name: str,
    antialiased: bool,
) -> None:
    if engine == "webgpu":
        request.getfixturevalue("adapter")
    camera = through(camera, name)
    scene = a_scene(make_gaussians, name, 60, 0.05 if antialiased else 0.15)
    features = np.random.default_rng(2).normal(size=(60, FEATURES)).astype(np.float32)

    def computed(name: str) -> tuple[Raster, RasterGradient]:
        rasterizer = Rasterizer(name)  # type: ignore[arg-type]
        raster = rasterizer.forward(scene, camera, (*OUTPUTS, "radii"), features=features, antialiased=antialiased)
        return raster, rasterizer.backward(raster, **weights(6, raster), pose=True)

    (found, d_found), (expected, d_expected) = computed(engine), computed("reference")
    assert np.count_nonzero(np.any(expected.radii > 0, axis=1)) > 30
    for output in OUTPUTS:
        one, other = getattr(found, output), getattr(expected, output)
        solid = expected.alpha > 0.05 if output == "depth" else np.ones(one.shape, bool)
        assert np.mean(np.abs(one - other)[solid] > 2e-3) < 0.01, output
    np.testing.assert_allclose(found.radii, expected.radii, rtol=1e-3, atol=1e-3)
    for field in fields(d_expected):
        one, other = getattr(d_found, field.name), getattr(d_expected, field.name)
        if other is not None:
            assert np.quantile(np.abs(one - other), 0.99) < 5e-3 * np.abs(other).max(), field.name


@pytest.mark.parametrize("name", ["pinhole", "opencv"])
def test_gaussians_beside_the_image_have_the_gradients_of_the_reference(
    make_gaussians: MakeGaussians, engine: str, name: str
) -> None:
    """Beyond its sides and corners, where the Jacobian is that of the margin's edge, but reaching into it."""
    camera = replace(camera_in_front(40, 30, 40.0), lens=LENSES[name])
    scene = make_gaussians(count=24, sh_degree=1, size=0.6, seed=3)
    places = [(x, y) for x in (-3.4, 0.2, 3.4) for y in (-2.7, 0.1, 2.7) if abs(x) + abs(y) > 1.0]
    scene.means[:, :2] = np.tile(places, (3, 1)) + np.random.default_rng(1).uniform(-0.1, 0.1, (24, 2))
    scene.means[:, 2] = np.linspace(-0.2, 0.2, 24)

    def gradients_of(name: str) -> RasterGradient:
        rasterizer = Rasterizer(name)  # type: ignore[arg-type]
        raster = rasterizer.forward(scene, camera, ("rgb", "alpha", "radii"))
        assert np.count_nonzero(raster.radii[:, 0]) > 18
        rng = np.random.default_rng(6)
        return rasterizer.backward(raster, rgb=rng.normal(size=(30, 40, 3)), alpha=rng.normal(size=(30, 40)), pose=True)

    found, expected = gradients_of(engine), gradients_of("reference")
    for group in ("means", "log_scales", "rotations", "opacity_logits", "pose"):
        one, other = getattr(found, group), getattr(expected, group)
        np.testing.assert_allclose(one, other, atol=5e-3 * np.abs(other).max(), err_msg=group)


@pytest.mark.parametrize(("model", "coefficients"), [("opencv", 12), ("fisheye", 4)])
def test_every_coefficient_bends_images_and_gradients_as_in_the_reference(
    engine: str, model: str, coefficients: int
) -> None:
    """One after the other, so large that its higher powers count; a few Gaussians are close to the axis."""
    rng, count = np.random.default_rng(3), 30
    means = rng.uniform([-3.0, -2.2, -1.0], [3.0, 2.2, 1.0], (count, 3))
    means[:6, :2] *= 0.1
    scene = Gaussians(
        means - (0.0, 0.0, 0.0 if model == "opencv" else 2.0),
        rng.uniform(-1.2, -0.2, (count, 3)),
        rng.normal(size=(count, 4)),
        np.full(count, -1.0),
        rng.normal(size=(count, 1, 3)),
    )
    rasterizers: list[Rasterizer] = [Rasterizer(name) for name in (engine, "reference")]  # type: ignore[arg-type]
    d_rgb, d_alpha = rng.normal(size=(30, 40, 3)), rng.normal(size=(30, 40))
    for coefficient in 0.1 * np.eye(coefficients):
        camera = replace(camera_in_front(40, 30, 18.0), lens=Lens(model, tuple(coefficient)))
        found, expected = (rasterizer.forward(scene, camera, ("rgb", "alpha")) for rasterizer in rasterizers)
        np.testing.assert_allclose(found.rgb, expected.rgb, atol=1e-4, err_msg=str(coefficient))
        d_found, d_expected = (
            rasterizer.backward(raster, rgb=d_rgb, alpha=d_alpha)
            for rasterizer, raster in zip(rasterizers, (found, expected), strict=True)
        )
        for group in ("means", "log_scales", "rotations"):
            one, other = getattr(d_found, group), getattr(d_expected, group)
            np.testing.assert_allclose(one, other, atol=3e-5 * np.abs(other).max(), err_msg=f"{group} {coefficient}")


def test_close_to_a_fisheyes_axis_gradients_are_those_of_the_reference(engine: str) -> None:
    """Just inside and just outside the angle below which quotients by the distance from the axis are power series."""
    camera, rng = replace(camera_in_front(40, 30, 18.0), lens=CULLED_THROUGH["fisheye"]), np.random.default_rng(4)
    depths, turns = np.linspace(1.5, 2.5, 20), rng.uniform(0.0, 2.0 * np.pi, 20)
    slopes = np.tile([0.09, 0.095, 0.099, 0.101], 5)
    scene = Gaussians(
        np.column_stack([slopes * depths * np.cos(turns), slopes * depths * np.sin(turns), depths - 4.0]),
        rng.uniform(-1.2, -0.2, (20, 3)),
        rng.normal(size=(20, 4)),
        np.full(20, -2.0),
        np.zeros((20, 1, 3)),
    )
    d_alpha, gradients = rng.normal(size=(30, 40)), []
    for name in (engine, "reference"):
        rasterizer = Rasterizer(name)  # type: ignore[arg-type]
        raster = rasterizer.forward(scene, camera, ("alpha",))
        gradients.append(rasterizer.backward(raster, alpha=d_alpha).means)
    np.testing.assert_allclose(*gradients, atol=1e-5 * np.abs(gradients[1]).max())


@pytest.mark.parametrize(("engine_name", "name"), [("cpu", "fisheye"), ("webgpu", "fisheye"), ("webgpu", "opencv")])
def test_a_training_step_through_a_lens_agrees(
    request: pytest.FixtureRequest, camera: Camera, make_gaussians: MakeGaussians, engine_name: EngineName, name: str
) -> None:
    if engine_name == "webgpu":
        request.getfixturevalue("adapter")
    camera = through(camera, name)
    gaussians, frame = a_scene(make_gaussians, name, 60, 0.15), photograph(camera)
    settings_of_step = StepSettings(RATES, LossSettings(), background=BACKGROUND)
    engine = begin(create_engine(EngineOptions(engine_name)), gaussians, [frame])
    engine.step(0, settings_of_step)
    loss, gradient, _ = reference_step(Scene.of(gaussians), frame, settings_of_step)
    assert engine.loss() == pytest.approx(loss, rel=1e-4)
    measured = engine.optimiser_state().first_moments / (1.0 - settings_of_step.adam.beta1)
    error = np.abs(measured - columns(gradient))[:, :3]
    assert np.quantile(error, 0.99) < 2e-3 * np.abs(gradient.means).max()


@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
def test_antialiasing_keeps_what_a_small_gaussian_adds_to_the_image(engine: str) -> None:
    camera = Camera(21, 21, 20.0, 20.0, 10.5, 10.5, np.eye(4))
    totals = {}
    for size in (0.01, 0.02):
        scene = Gaussians(
            np.array([[0.0, 0.0, 1.0]]),
            np.log(np.full((1, 3), size)),
            np.eye(4)[:1],
            np.full(1, 3.0),
            np.ones((1, 1, 3)),
        )
        rasterizer = Rasterizer(engine)  # type: ignore[arg-type]
        for antialiased in (False, True):
            raster = rasterizer.forward(scene, camera, ("alpha",), antialiased=antialiased)
            totals[size, antialiased] = float(raster.alpha.sum())
    # Twice the size is four times the area; without the filter both look about as large as a pixel.
    assert totals[0.02, True] / totals[0.01, True] == pytest.approx(4.0, rel=0.2)
    assert totals[0.02, False] / totals[0.01, False] < 1.6


@pytest.mark.parametrize("name", BENT)
@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_what_is_visible_is_in_a_cluster_in_view(name: str, seed: int) -> None:
    scene, camera = around(seed, 1500), through(a_camera(np.random.default_rng(seed)), name)
    near = 0.05
    found = Clusters(len(scene)).in_view(scene, View.of(camera), kernel_lens(camera), near, 2)
    visible = np.flatnonzero(project(Scene.of(scene), camera, near).visible)
    assert np.isin(visible // CLUSTER, found).all()


CULLED_THROUGH = {
    "fisheye": Lens("fisheye", (0.0, 0.0, 0.0, 0.0)),
    "bent fisheye": LENSES["fisheye"],
    "opencv": Lens("opencv", (-0.1, 0.01, 0.0, 0.0)),
    "wide opencv": Lens("opencv", (-0.01, 0.0, 0.0, 0.0)),
}


def at_a_corner(name: str, copies: int) -> tuple[Gaussians, Camera, np.ndarray]:
    """Gaussians whose directions move out through a corner of the view, where bounds of a lens are tightest.

    Returns:
        800 Gaussians, each so many times that it is a cluster of its own; the camera; and (800,) bool, whether the
        reference draws each.
    """
    camera = Camera(64, 48, 25.0, 25.0, 32.0, 24.0, np.eye(4), CULLED_THROUGH[name])
    rng, count = np.random.default_rng(0), 800
    angles = np.linspace(0.0, 1.5 if camera.lens.model == "opencv" else 2.9, count)
    across = np.array([0.8, 0.6]) * rng.choice([-1.0, 1.0], (count, 2))
    scene = Gaussians(
        5.0 * np.column_stack([np.sin(angles)[:, None] * across, np.cos(angles)]),
        np.repeat(rng.choice([-8.0, -2.0, -1.0, 0.0], (count, 1)), 3, axis=1),
        rng.normal(size=(count, 4)),
        np.full(count, 6.0),
        np.zeros((count, 1, 3)),
    )
    visible = project(Scene.of(scene), camera).visible
    return scene.select(np.repeat(np.arange(count), copies)), camera, visible


@pytest.mark.parametrize("name", CULLED_THROUGH)
def test_culling_through_a_lens_loses_nothing_at_a_corner(name: str) -> None:
    scene, camera, visible = at_a_corner(name, CLUSTER)
    clusters = Clusters(len(scene)).in_view(scene, View.of(camera), kernel_lens(camera), near_plane(scene.means), 2)
    found = np.isin(np.arange(len(visible)), clusters)
    assert not np.any(visible & ~found)
    assert found.mean() < 0.95


@pytest.mark.parametrize("name", CULLED_THROUGH)
def test_what_a_lens_shows_at_a_corner_is_what_the_reference_shows(engine: str, name: str) -> None:
    """Nothing beyond the angle at which the lens would fold the image back."""
    scene, camera, expected = at_a_corner(name, 1)
    raster = Rasterizer(engine).forward(scene, camera, ("radii",))  # type: ignore[arg-type]
    assert np.mean((raster.radii[:, 0] > 0.0) != expected) < 0.005


@pytest.mark.parametrize("name", ["pinhole", "orthographic"])
def test_culling_without_distortion_loses_nothing_beside_the_image(name: str) -> None:
    """Needles and balls, each a cluster of its own, so that its bounds are as tight as can be."""
    focal = 24.0 if name == "pinhole" else 6.0
    camera, rng = replace(camera_in_front(24, 16, focal), lens=LENSES[name]), np.random.default_rng(3)
    pixels = rng.uniform([-26.0, -26.0], [50.0, 42.0], (1000, 2))
    pixels = pixels[np.any((pixels < 0.0) | (pixels > (24.0, 16.0)), axis=1)]
    count = len(pixels)
    log_scales = rng.uniform(-7.0, 0.0, (count, 3))
    log_scales[::2] = log_scales[::2, :1]
    scene = Gaussians(
        np.column_stack([(pixels - (12.0, 8.0)) / 6.0, np.zeros(count)]),
        log_scales,
        rng.normal(size=(count, 4)),
        np.full(count, 6.0),
        np.zeros((count, 1, 3)),
    )
    copies = scene.select(np.repeat(np.arange(count), CLUSTER))
    found = Clusters(len(copies)).in_view(copies, View.of(camera), kernel_lens(camera), 0.05, 2)
    visible = project(Scene.of(scene), camera, 0.05).visible
    assert 0.05 < visible.mean() < 0.5
    assert np.isin(np.flatnonzero(visible), found).all()
    assert len(found) < 0.8 * count


@pytest.mark.parametrize("name", LENSES)
def test_a_cluster_around_the_camera_is_not_culled(name: str) -> None:
    """All but one of its Gaussians are behind the camera, and so is its middle."""
    camera = replace(Camera(64, 48, 80.0, 80.0, 32.0, 24.0, np.eye(4)), lens=LENSES[name])
    means = np.tile([0.0, 0.0, -4.0], (CLUSTER, 1))
    means[7, 2] = 2.0
    scene = Gaussians(
        means,
        np.full((CLUSTER, 3), -4.0),
        np.tile([1.0, 0, 0, 0], (CLUSTER, 1)),
        np.full(CLUSTER, 6.0),
        np.zeros((CLUSTER, 1, 3)),
    )
    assert np.flatnonzero(project(Scene.of(scene), camera).visible).tolist() == [7]
    assert Clusters(CLUSTER).in_view(scene, View.of(camera), kernel_lens(camera), 0.05, 2).tolist() == [0]


@pytest.mark.parametrize("name", LENSES)
def test_a_cluster_just_beyond_the_near_plane_is_not_culled(name: str) -> None:
    camera = replace(Camera(64, 48, 80.0, 80.0, 32.0, 24.0, np.eye(4)), lens=LENSES[name])
    one = Gaussians([[0.0, 0.0, 0.06]], np.full((1, 3), -6.0), [[1.0, 0, 0, 0]], [6.0], np.zeros((1, 1, 3)))
    for near, expected in ((0.05, [0]), (0.07, [])):
        assert np.flatnonzero(project(Scene.of(one), camera, near).visible).tolist() == expected
        assert Clusters(1).in_view(one, View.of(camera), kernel_lens(camera), near, 1).tolist() == expected


def test_bounds_of_every_views_lens_are_kept() -> None:
    views = [
        replace(Camera(64, 48, 40.0, 40.0, 32.0, 24.0, np.eye(4)), lens=Lens("opencv", (-1e-4 * i, 0.0, 0.0, 0.0)))
        for i in range(1, 151)
    ]
    kept = (largest_angle, least_radii, stretch, least_radius_per_radian, slope_limits_through)
    misses = []
    for _ in range(3):
        for view in views:
            stretch(view.lens, *(tuple(map(float, ends)) for ends in slope_limits(view)))
            least_radius_per_radian(view.lens)
        misses.append([function.cache_info().misses for function in kept])
    assert misses[0] == misses[1] == misses[2]


def test_a_lens_needs_hardly_more_clusters_than_a_pinhole() -> None:
    scene = around(1, 20_000)
    scene.log_scales -= 5.0
    pose = look_at(np.array([0.0, 0.0, -4.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    found = {}
    for name, lens in LENSES.items():
        camera = replace(Camera(40, 30, 120.0, 120.0, 20.0, 15.0, pose), lens=lens)
        found[name] = len(Clusters(len(scene)).in_view(scene, View.of(camera), kernel_lens(camera), 0.05, 2))
    assert found["pinhole"] < 0.8 * len(scene) / CLUSTER
    assert max(found.values()) <= 1.2 * found["pinhole"]


@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
def test_a_fisheye_shows_what_stands_behind_it_and_not_what_its_polynomial_folds_over(engine: str) -> None:
    for coefficients, expected in (((0.0, 0.0, 0.0, 0.0), True), ((-0.15, 0.0, 0.0, 0.0), False)):
        camera = Camera(60, 60, 10.0, 10.0, 30.0, 30.0, np.eye(4), Lens("fisheye", coefficients))
        # 110 degrees off axis.
        mean = np.array([[np.sin(np.radians(110)), 0.0, np.cos(np.radians(110))]])
        scene = Gaussians(mean, np.full((1, 3), -3.0), np.eye(4)[:1], np.full(1, 4.0), np.ones((1, 1, 3)))
        raster = Rasterizer(engine).forward(scene, camera, ("alpha", "depth"), near=0.1)  # type: ignore[arg-type]
        assert (raster.alpha.max() > 0.5) == expected
        if expected:
            assert np.unravel_index(np.argmax(raster.alpha), raster.alpha.shape) == (29, 49)
            assert raster.depth.max() == pytest.approx(1.0, abs=1e-3)
