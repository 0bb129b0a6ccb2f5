"""The rasterizer: the reference's gradients against finite differences, and the engines against it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from scipy.spatial.transform import Rotation

from pocketgs import Rasterizer
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.geometry.lens import Lens
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.rasterizer import OUTPUTS, Raster
from pocketgs.splat.reference import project as reference_project
from pocketgs.splat.reference import rasterize as reference_rasterize
from pocketgs.splat.reference.adam import rotate
from pocketgs.splat.reference.scene import Scene
from splat.training_step import BACKGROUND, EDITS, a_million_off_screen, camera_in_front, sheets, with_hostile_numbers

MakeGaussians = Callable[..., Gaussians]

STEP = 1e-6
DIFFERENTIABLE = ("rgb", "alpha", "depth", "normals", "features")
GROUPS = ("means", "log_scales", "rotations", "quaternions", "opacity_logits", "sh", "features", "background", "pose")


def weights_for(raster: Raster, names: tuple[str, ...] = DIFFERENTIABLE) -> dict[str, np.ndarray]:
    """A gradient for each output. Depth counts only where something covers the pixel: it is divided by alpha."""
    rng = np.random.default_rng(5)
    weights = {name: rng.normal(size=getattr(raster, name).shape) for name in names}
    if "depth" in weights:
        weights["depth"] *= raster.alpha > 0.05
    return weights


@pytest.fixture
def _no_cutoff(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loss jumps where a contribution crosses 1/255; finite differences must not cross a jump."""
    for module in (reference_project, reference_rasterize):
        monkeypatch.setattr(module, "ALPHA_MIN", 1e-12)


def moved(camera: Camera, twist: np.ndarray) -> Camera:
    """The camera after its pose has been multiplied by exp(ξ), for a small ξ = (τ, ω)."""
    change = np.eye(4)
    change[:3, :3] = Rotation.from_rotvec(twist[3:]).as_matrix()
    change[:3, 3] = twist[:3]
    return replace(camera, world_to_camera=change @ camera.world_to_camera)


@pytest.mark.usefixtures("_no_cutoff")
@pytest.mark.parametrize(("outputs", "sh_degree"), [(DIFFERENTIABLE, 2), (("features",), 0), (("depth", "alpha"), 0)])
def test_gradients_of_the_reference(
    camera: Camera, make_gaussians: MakeGaussians, outputs: tuple[str, ...], sh_degree: int
) -> None:
    scene = Scene.of(make_gaussians(count=6, sh_degree=sh_degree, seed=3, size=0.3))
    rasterizer = Rasterizer("reference")
    start: dict[str, Any] = {"twist": np.zeros(6), "background": np.array(BACKGROUND), "tangents": np.zeros((6, 3))}
    start |= {name: getattr(scene, name) for name in PARAMETERS}
    start["features"] = np.random.default_rng(1).normal(size=(6, 5))

    def render(inputs: dict[str, Any]) -> Raster:
        parameters = Scene(*(inputs[name] for name in PARAMETERS))
        parameters.quaternions = rotate(parameters.quaternions, inputs["tangents"])
        if not np.any(inputs["tangents"]):
            parameters.quaternions = inputs["quaternions"]
        features = inputs["features"] if "features" in outputs else None
        view = moved(camera, inputs["twist"])
        return rasterizer.forward(parameters, view, outputs, features=features, background=tuple(inputs["background"]))

    raster = render(start)
    weights = weights_for(raster, outputs)
    gradient = rasterizer.backward(raster, **weights, pose=True)

    def loss(inputs: dict[str, Any]) -> float:
        seen = render(inputs)
        return float(sum(np.sum(getattr(seen, name) * weight) for name, weight in weights.items()))

    inputs_of = {"rotations": "tangents", "pose": "twist"}
    rng = np.random.default_rng(9)
    for group in GROUPS:
        analytic = getattr(gradient, group)
        if analytic is None:
            continue
        indices = list(np.ndindex(analytic.shape))
        for pick in rng.permutation(len(indices))[:18]:
            values = []
            for sign in (1.0, -1.0):
                inputs = dict(start)
                inputs[inputs_of.get(group, group)] = inputs[inputs_of.get(group, group)].copy()
                inputs[inputs_of.get(group, group)][indices[pick]] += sign * STEP
                values.append(loss(inputs))
            expected = (values[0] - values[1]) / (2 * STEP)
            error = abs(analytic[indices[pick]] - expected)
            assert error < 1e-5 * np.abs(analytic).max() + 1e-6, (group, indices[pick])
    assert np.abs(gradient.means).max() > 0


@pytest.mark.usefixtures("_no_cutoff")
def test_the_matrix_gradient_says_what_the_pose_gradient_does(camera: Camera, make_gaussians: MakeGaussians) -> None:
    scene = Scene.of(make_gaussians(count=6, sh_degree=1, size=0.3))
    rasterizer = Rasterizer("reference")
    raster = rasterizer.forward(scene, camera)
    gradient = rasterizer.backward(raster, **weights_for(raster, ("rgb",)), pose=True)
    assert gradient.pose is not None
    assert gradient.world_to_camera is not None
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = 1e-6
        step = (moved(camera, twist).world_to_camera - moved(camera, -twist).world_to_camera)[:3] / 2e-6
        assert np.sum(gradient.world_to_camera * step) == pytest.approx(gradient.pose[k], rel=1e-6, abs=1e-9)


@cache
def shared(engine: Any) -> Rasterizer:
    """A rasterizer whose shaders are compiled once for all tests."""
    return Rasterizer(engine)


def every_output(engine: Any, gaussians: Gaussians, camera: Camera, features: np.ndarray) -> Raster:
    return shared(engine).forward(gaussians, camera, OUTPUTS, features=features, background=BACKGROUND)


@pytest.mark.parametrize(("count", "size", "channels"), [(1, 0.3, 1), (60, 0.15, 16), (400, 0.06, 40)])
def test_engines_agree_with_the_reference(
    engine: str, camera: Camera, make_gaussians: MakeGaussians, count: int, size: float, channels: int
) -> None:
    gaussians = make_gaussians(count=count, sh_degree=2, size=size, seed=count)
    features = np.random.default_rng(2).normal(size=(count, channels)).astype(np.float32)
    found, expected = (every_output(one, gaussians, camera, features) for one in (engine, "reference"))
    for name in (*DIFFERENTIABLE, "median_depth"):
        one, other = getattr(found, name), getattr(expected, name)
        solid = np.ones(one.shape, bool) if name != "depth" else expected.alpha > 0.05
        # A contribution at the very edge of 1/255 may fall on either side, the median on the next splat.
        assert np.mean(np.abs(one - other)[solid] > 2e-3) < 0.01, name
    np.testing.assert_allclose(found.radii, expected.radii, rtol=1e-3, atol=1e-3)
    assert found.contributions is not None
    assert expected.contributions is not None
    for field in fields(found.contributions):
        one, other = (getattr(raster.contributions, field.name) for raster in (found, expected))
        assert np.quantile(np.abs(one - other), 0.95) <= 2e-3 * max(1.0, other.max()), field.name

    weights = weights_for(expected)
    d_found, d_expected = (
        shared(one).backward(raster, **weights, pose=True, absolute=True)
        for one, raster in ((engine, found), ("reference", expected))
    )
    for field in fields(d_expected):
        one, other = getattr(d_found, field.name), getattr(d_expected, field.name)
        scale = np.abs(other).max()
        assert one.shape == other.shape, field.name
        assert np.quantile(np.abs(one - other), 0.99 if one.size > 100 else 1.0) < 5e-3 * scale, field.name


def test_same_bits_on_any_number_of_threads(make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(90, 70, 90.0)
    gaussians = make_gaussians(count=1500, sh_degree=1, size=0.06)
    features = np.random.default_rng(2).normal(size=(1500, 6)).astype(np.float32)
    results = []
    for threads in (1, 2):
        rasterizer = Rasterizer("cpu", threads)
        raster = rasterizer.forward(gaussians, camera, OUTPUTS, features=features)
        weights = weights_for(raster)
        results.append((raster, rasterizer.backward(raster, **weights, pose=True, absolute=True)))
    (one, d_one), (other, d_other) = results
    for name in (*DIFFERENTIABLE, "median_depth", "radii"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    for field in fields(d_one):
        assert getattr(d_one, field.name).tobytes() == getattr(d_other, field.name).tobytes(), field.name


def test_what_is_asked_for_does_not_change_the_rest(engine: str, camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=80)
    features = np.ones((80, 20), np.float32)
    alone = shared(engine).forward(gaussians, camera)
    assert alone.alpha is None
    assert alone.contributions is None
    together = every_output(engine, gaussians, camera, features)
    np.testing.assert_allclose(together.rgb - alone.rgb, (1.0 - together.alpha)[..., None] * BACKGROUND, atol=1e-6)


@pytest.mark.parametrize("outputs", [("alpha",), ("features",), ("rgb", "normals")])
def test_a_part_of_the_outputs_has_the_gradients_of_the_reference(
    engine: str, camera: Camera, make_gaussians: MakeGaussians, outputs: tuple[Any, ...]
) -> None:
    gaussians = make_gaussians(count=40, sh_degree=1)
    features = np.random.default_rng(3).normal(size=(40, 4)) if "features" in outputs else None
    gradients = []
    for one in (engine, "reference"):
        raster = shared(one).forward(gaussians, camera, outputs, features=features)
        # Another image in between does not change what is gone back from.
        shared(one).forward(gaussians.select(np.arange(7)), camera_in_front(20, 10, 20.0))
        gradients.append(shared(one).backward(raster, **weights_for(raster, outputs)))
    for group in ("means", "log_scales", "rotations", "opacity_logits", "sh", "centres"):
        found, expected = (getattr(gradient, group) for gradient in gradients)
        np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max() + 1e-12, err_msg=group)


@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
def test_contributions_to_many_views_are_those_to_each(make_gaussians: MakeGaussians, engine: str) -> None:
    gaussians = make_gaussians(count=120, size=0.15)
    # The second is larger than the first, so that a GPU's buffers grow in between.
    cameras = [camera_in_front(20, 10, 20.0), camera_in_front(60, 40, 60.0), camera_in_front(20, 10, 30.0)]
    rasterizer = Rasterizer(engine)  # type: ignore[arg-type]
    for camera, found in zip(cameras, rasterizer.contributions(gaussians, cameras), strict=True):
        expected = shared(engine).forward(gaussians, camera, ("contributions",)).contributions
        assert expected.pixels.any()
        for field in fields(found):
            np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name), field.name)
    with pytest.raises(PocketGSError, match="needs the compositor over"):
        Rasterizer("cpu", compositor="sum").contributions(gaussians, cameras)


@pytest.mark.usefixtures("adapter")
def test_lists_that_outgrow_their_room(
    monkeypatch: pytest.MonkeyPatch, camera: Camera, make_gaussians: MakeGaussians
) -> None:
    gaussians = make_gaussians(count=200, size=0.4)
    expected = shared("webgpu").forward(gaussians, camera, ("rgb", "contributions"))
    monkeypatch.setattr("pocketgs.splat.webgpu.image_lists.MIN_INTERSECTIONS", 16)
    found = Rasterizer("webgpu").forward(gaussians, camera, ("rgb", "contributions"))
    np.testing.assert_array_equal(found.rgb, expected.rgb)
    np.testing.assert_array_equal(found.contributions.summed, expected.contributions.summed)


@pytest.mark.usefixtures("adapter")
def test_room_that_is_refused_leaves_the_rasterizer_usable(
    monkeypatch: pytest.MonkeyPatch, camera: Camera, make_gaussians: MakeGaussians
) -> None:
    """Headroom is left out where only what is needed fits."""
    monkeypatch.setattr("pocketgs.splat.webgpu.image_lists.MIN_INTERSECTIONS", 16)
    gaussians, more = make_gaussians(count=50), make_gaussians(count=2000, size=0.4)
    rasterizer = Rasterizer("webgpu")
    lists = rasterizer._backend._lists  # type: ignore[attr-defined]
    rasterizer.forward(gaussians, camera, ("alpha",))
    needed = lists.symbols["intersections"]
    expected = shared("webgpu").forward(gaussians, camera, ("alpha",)).alpha
    largest = max(lists._executor.sizes().values())
    monkeypatch.setattr(lists, "_largest", largest)
    with pytest.raises(PocketGSError, match="the device allows"):
        rasterizer.forward(more, camera, ("alpha",))
    np.testing.assert_array_equal(rasterizer.forward(gaussians, camera, ("alpha",)).alpha, expected)
    monkeypatch.setattr("pocketgs.splat.webgpu.image_lists.GROWTH", 1000.0)
    lists._room = 16
    np.testing.assert_array_equal(rasterizer.forward(gaussians, camera, ("alpha",)).alpha, expected)
    assert lists.symbols["intersections"] == needed


@pytest.mark.parametrize("name", ["cpu", "webgpu", "reference"])
def test_infinite_logits_are_opaque_or_invisible(request: pytest.FixtureRequest, name: str) -> None:
    """Scales of 0 are drawn, as flat discs."""
    if name == "webgpu":
        request.getfixturevalue("adapter")
    camera = camera_in_front(33, 21, 30.0)
    disc = Gaussians(np.zeros((1, 3)), np.full((1, 3), -1.0), [[1, 0, 0, 0]], [np.inf], np.zeros((1, 1, 3)))
    assert shared(name).forward(disc, camera, ("alpha",)).alpha.max() > 0.98
    seen = shared(name).forward(disc, camera, ("rgb", "alpha"))
    gradient = shared(name).backward(seen, rgb=np.ones((21, 33, 3)), alpha=np.ones((21, 33)))
    assert abs(gradient.opacity_logits[0]) < 1e-4
    assert np.isfinite(gradient.means).all()
    hidden = replace(disc, opacity_logits=[-np.inf])
    assert shared(name).forward(hidden, camera, ("alpha",)).alpha.max() == 0.0
    flat, thin = (replace(disc, log_scales=[[-1, -1, thickness]]) for thickness in (-np.inf, -80.0))
    alphas = [shared(name).forward(scene, camera, ("alpha",)).alpha for scene in (flat, thin)]
    np.testing.assert_array_equal(*alphas)
    assert alphas[0].max() > 0.98


@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
def test_a_gaussian_as_opaque_as_can_be_has_no_gradient_of_its_shape(engine: str) -> None:
    raster = shared(engine).forward(sheets(np.array([0.999])), camera_in_front(8, 16, 16.0), ("rgb", "alpha"))
    np.testing.assert_allclose(raster.alpha, 0.99, atol=1e-6)
    gradient = shared(engine).backward(raster, rgb=np.ones((16, 8, 3)), alpha=np.ones((16, 8)))
    for group in ("means", "log_scales", "rotations", "opacity_logits"):
        assert not getattr(gradient, group).any(), group
    assert gradient.sh.all()


@pytest.mark.parametrize("before", [3, 16])
@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
def test_what_fills_a_pixel_has_a_gradient_and_what_is_behind_has_none(engine: str, before: int) -> None:
    """Some sheets let 5e-4 of the light through, the next one takes nine tenths of that; three more are behind."""
    scene = sheets(np.array([*[1.0 - 5e-4 ** (1.0 / before)] * before, 0.9, 0.9, 0.9, 0.9]))
    camera = camera_in_front(8, 16, 16.0)
    raster = shared(engine).forward(scene, camera, ("features",), features=np.ones((before + 4, 1)))
    gradient = shared(engine).backward(raster, features=np.ones((16, 8, 1)))
    assert gradient.features[before, 0] == pytest.approx(8 * 16 * 5e-4 * 0.9, rel=0.01)
    assert not gradient.features[before + 1 :].any()
    assert not gradient.means[before + 1 :].any()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
def test_a_needle_that_has_diverged_along_either_side_is_not_drawn(engine: str, axis: int) -> None:
    needle = sheets(np.array([0.9]))
    for length, expected in ((5.0, 0.9), (13.0, 0.0)):
        needle.log_scales[:] = np.where(np.arange(3) == axis, length, -1.0)
        alpha = shared(engine).forward(needle, camera_in_front(8, 16, 16.0), ("alpha",)).alpha
        assert alpha.max() == pytest.approx(expected, abs=0.1)


def test_needles_across_both_axes_are_drawn_up_to_the_length_that_the_reference_draws(engine: str) -> None:
    """Beyond some thousand times their width, float32 cannot represent their covariance."""
    lengths = np.linspace(2.35, 9.35, 15)
    needles = sheets(np.full(15, 0.9))
    needles.log_scales[:] = np.column_stack([lengths, np.full((15, 2), -6.0)])
    needles.quaternions[:] = (np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8))
    found, expected = (
        shared(one).forward(needles, camera_in_front(8, 16, 16.0), ("radii",)).radii.any(axis=1)
        for one in (engine, "reference")
    )
    np.testing.assert_array_equal(found, expected)
    assert 3 < np.count_nonzero(expected) < 12


def test_beside_the_image_those_are_drawn_that_reach_a_pixel(engine: str) -> None:
    """Around all of its sides; a few may be at the very edge of 1/255, and fall on either side."""
    camera, rng = camera_in_front(24, 16, 24.0), np.random.default_rng(3)
    pixels = rng.uniform([-8.0, -8.0], [32.0, 24.0], (2000, 2))
    pixels = pixels[np.any((pixels < 0.0) | (pixels > (24.0, 16.0)), axis=1)]
    count = len(pixels)
    scene = Gaussians(
        np.column_stack([(pixels - (12.0, 8.0)) / 6.0, np.zeros(count)]),
        rng.uniform(-4.0, -1.2, (count, 3)),
        rng.normal(size=(count, 4)),
        rng.uniform(-4.0, 8.0, count),
        np.zeros((count, 1, 3)),
    )
    found, expected = (
        np.any(shared(one).forward(scene, camera, ("radii",)).radii > 0.0, axis=1) for one in (engine, "reference")
    )
    assert 0.2 < expected.mean() < 0.8
    assert np.mean(found != expected) < 0.002


def test_drawing_goes_on_while_two_rows_of_pixels_are_not_full(engine: str) -> None:
    """Opaque stripes, three on each of the other rows, and faint sheets behind them."""
    camera = camera_in_front(8, 16, 16.0)
    for open_row in range(0, 16, 2):
        rows = np.array([row for row in range(16) if row // 2 != open_row // 2] * 3)
        scene = sheets(np.repeat([0.98, 0.12], [len(rows), 20]))
        scene.means[:, 2] *= 0.1
        scene.means[: len(rows), 1] = (rows - 7.5) / 4.0
        scene.log_scales[: len(rows), 1:] = -3.0
        alpha = shared(engine).forward(scene, camera, ("alpha",)).alpha
        assert 0.9 < alpha[open_row : open_row + 2].min() < 0.99, open_row
        assert np.delete(alpha, [open_row, open_row + 1], axis=0).min() > 0.999


def test_every_pixel_is_drawn_whatever_the_size_of_the_image(engine: str) -> None:
    """The last column or row may be alone in its tile."""
    for size in (1, 7, 8, 9, 16, 17, 33):
        for width, height in ((size, 3), (3, size)):
            raster = shared(engine).forward(
                sheets(np.array([0.9])), camera_in_front(width, height, 16.0), ("alpha", "contributions")
            )
            np.testing.assert_allclose(raster.alpha, 0.9, atol=1e-3)
            assert raster.contributions.pixels.tolist() == [3 * size]


def test_an_orthographic_camera_does_not_show_its_own_plane(engine: str) -> None:
    camera = Camera(21, 15, 10.0, 10.0, 10.0, 7.0, np.eye(4), Lens("orthographic"))
    disc = Gaussians(np.zeros((1, 3)), np.full((1, 3), -1.0), [[1, 0, 0, 0]], [3.0], np.zeros((1, 1, 3)))
    assert shared(engine).forward(disc, camera, ("alpha",), near=0.0).alpha.max() == 0.0


def test_nothing_to_see(engine: str, make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(20, 10, 20.0)
    for gaussians in (make_gaussians(count=0), a_million_off_screen().select(np.arange(50))):
        features = np.ones((len(gaussians), 2))
        raster = every_output(engine, gaussians, camera, features)
        assert raster.alpha is not None
        assert raster.alpha.max() == 0.0
        assert np.all(raster.rgb == np.array(BACKGROUND, np.float32))
        gradient = shared(engine).backward(raster, **weights_for(raster), pose=True, absolute=True)
        assert not np.any(gradient.means)
        assert not np.any(gradient.pose)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=EDITS)
def test_hostile_numbers_leave_images_and_gradients_finite(engine: str, edits: list[tuple[int, float]]) -> None:
    gaussians, camera = with_hostile_numbers(edits), camera_in_front(33, 21, 30.0)
    raster = every_output(engine, gaussians, camera, np.ones((20, 2)))
    for name in (*DIFFERENTIABLE, "median_depth", "radii"):
        assert np.all(np.isfinite(getattr(raster, name))), name
    gradient = shared(engine).backward(raster, **weights_for(raster), pose=True, absolute=True)
    drawn = np.any(raster.radii > 0, axis=1)
    for name in ("means", "log_scales", "rotations", "quaternions", "opacity_logits", "sh", "features"):
        assert not np.any(getattr(gradient, name)[~drawn]), name


@pytest.mark.parametrize("engine", ["cpu", "webgpu", "reference"], indirect=True)
@pytest.mark.parametrize("thin", [0, 1, 2])
def test_normals_are_those_of_a_disc_towards_the_camera(engine: str, thin: int) -> None:
    """A turned disc, thin along any of its axes, from in front and from behind."""
    turn = Rotation.from_euler("xyz", [20.0, 15.0, 40.0], degrees=True)
    log_scales = np.where(np.arange(3) == thin, -6.0, [-0.5, -0.7, -0.9])[None]
    quaternion = turn.as_quat()[[3, 0, 1, 2]][None]
    disc = Gaussians(np.zeros((1, 3)), log_scales, quaternion, np.full(1, 6.0), np.zeros((1, 1, 3)))
    axis = turn.as_matrix()[:, thin]
    for eye in (4.0 * axis, -4.0 * axis):
        pose = look_at(eye, np.zeros(3), np.array([0.1, -1.0, 0.3]))
        seen = shared(engine).forward(disc, Camera(21, 21, 40.0, 40.0, 10.5, 10.5, pose), ("normals", "alpha"))
        assert seen.alpha[10, 10] > 0.9
        np.testing.assert_allclose(seen.normals[10, 10], seen.alpha[10, 10] * eye / 4.0, atol=1e-5)


def test_a_diverged_colour_hides_nothing_in_other_outputs(
    engine: str, camera: Camera, make_gaussians: MakeGaussians
) -> None:
    """A Gaussian is not drawn where its colour from the camera has diverged, whatever is asked for."""
    gaussians = make_gaussians(count=40, sh_degree=1, size=0.5)
    gaussians.sh[::5, 0, 1] = [np.nan, np.inf, -1e9, 1e5, 0.0, 0.0, 0.0, 0.0]
    gaussians.sh[20:35, 3, 2] = np.linspace(-3e5, 3e5, 15)  # too bright from some sides only
    cameras = [camera, camera_in_front(37, 29, 40.0)]
    together = [shared(engine).forward(gaussians, one, ("rgb", "depth", "radii", "contributions")) for one in cameras]
    of_many = shared(engine).contributions(gaussians, cameras)
    for one, expected, seen in zip(cameras, together, of_many, strict=True):
        drawn = np.any(expected.radii > 0, axis=1)
        assert 0 < np.sum(drawn[20:35]) < 15
        alone = shared(engine).forward(gaussians, one, ("depth", "radii", "contributions"))
        np.testing.assert_array_equal(np.any(alone.radii > 0, axis=1), drawn)
        np.testing.assert_allclose(alone.depth, expected.depth, rtol=1e-6)
        for found in (alone.contributions, seen):
            np.testing.assert_array_equal(found.summed, expected.contributions.summed)


def test_mistakes_are_named(camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=4)
    with pytest.raises(PocketGSError, match="'cuda', expected cpu, webgpu or reference"):
        Rasterizer("cuda")  # type: ignore[arg-type]
    with pytest.raises(PocketGSError, match="threads: found 0, expected at least 1"):
        Rasterizer("cpu", threads=0)
    with pytest.raises(PocketGSError, match="GPU 'nonsense' with engine 'cpu', expected it with webgpu only"):
        Rasterizer("cpu", gpu="nonsense")
    rasterizer = Rasterizer()
    with pytest.raises(PocketGSError, match="output 'colour', expected some of rgb"):
        rasterizer.forward(gaussians, camera, ("colour",))  # type: ignore[arg-type]
    with pytest.raises(PocketGSError, match="belong together"):
        rasterizer.forward(gaussians, camera, ("features",))
    with pytest.raises(PocketGSError, match=r"shape \(3, 2\), expected \(4, D\)"):
        rasterizer.forward(gaussians, camera, ("features",), features=np.ones((3, 2)))
    for near in (-0.1, float("nan"), float("inf")):
        with pytest.raises(PocketGSError, match=f"near plane at {near}, expected a depth of at least 0"):
            rasterizer.forward(gaussians, camera, near=near)
        with pytest.raises(PocketGSError, match="near plane"):
            rasterizer.contributions(gaussians, [camera], near=near)
    raster = rasterizer.forward(gaussians, camera, near=0.0)
    with pytest.raises(PocketGSError, match="gradient of depth, which was not among the outputs"):
        rasterizer.backward(raster, depth=np.zeros((29, 37)))
    with pytest.raises(PocketGSError, match=r"gradient of rgb has shape \(29, 37\), expected \(29, 37, 3\)"):
        rasterizer.backward(raster, rgb=np.zeros((29, 37)))
    for other in (Rasterizer("reference"), Rasterizer("cpu", compositor="sum")):
        with pytest.raises(PocketGSError, match="found an image of another engine or compositor"):
            other.backward(raster, rgb=np.zeros((29, 37, 3)))


def test_outputs_may_be_any_names(camera: Camera, make_gaussians: MakeGaussians) -> None:
    """One, or names that can be read once only."""
    gaussians = make_gaussians(count=4)
    one, several = (Rasterizer().forward(gaussians, camera, names) for names in ("rgb", iter(["rgb", "alpha"])))
    np.testing.assert_array_equal(one.rgb, several.rgb)
    assert one.alpha is None
    assert several.alpha is not None
