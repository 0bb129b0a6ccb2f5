"""Sort-free images: gradients by finite differences, engines against the reference, and numbers at their bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
import wgpu

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.sort_free import appearance, kernels
from pocketgs.sort_free.drawing import drawing_of
from pocketgs.sort_free.forms import FORMS, LARGEST_EXPONENT, FormName
from pocketgs.sort_free.renderer import SortFreeImage, SortFreeRenderer
from pocketgs.sort_free.scene import SortFreeScene, sort_free
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.webgpu.passes import describe_rendering
from pocketgs.splat.webgpu.variant import COVERAGES, Variant, Weights
from pocketgs.splat.webgpu.weighted import WeightedDrawing
from splat.training_step import camera_in_front

MakeGaussians = Callable[..., Gaussians]
every_form = pytest.mark.parametrize("form", FORMS)
BACKGROUND = (0.2, 0.5, 0.9)
GPU = EngineOptions("webgpu")


@cache
def shared(engine: Any) -> SortFreeRenderer:
    return SortFreeRenderer(engine)


def weighted_scene(gaussians: Gaussians, form: str, seed: int = 0) -> SortFreeScene:
    scene = sort_free(gaussians, form, 3.0)
    rng = np.random.default_rng(seed)
    return replace(
        scene, visibility_sh=(scene.visibility_sh + rng.normal(0.0, 0.3, scene.visibility_sh.shape)).astype(np.float32)
    )


def drawn(engine: str, scene: SortFreeScene, camera: Camera) -> SortFreeImage:
    return shared(engine).forward(scene, camera, BACKGROUND, depth=True)


def weights_of(image: SortFreeImage) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(4)
    depth = rng.normal(size=image.alpha.shape) * (image.alpha > 0.05)
    return {"rgb": rng.normal(size=image.rgb.shape), "depth": depth}


def in_float64(scene: SortFreeScene) -> SortFreeScene:
    return replace(scene, gaussians=Scene.of(scene.gaussians), visibility_sh=scene.visibility_sh.astype(np.float64))  # type: ignore[arg-type]


def copied(scene: SortFreeScene) -> SortFreeScene:
    gaussians = Scene(*(getattr(scene.gaussians, name).copy() for name in PARAMETERS))
    return replace(
        scene, gaussians=gaussians, log_shared=scene.log_shared.copy(), visibility_sh=scene.visibility_sh.copy()
    )  # type: ignore[arg-type]


@every_form
def test_gradients(camera: Camera, make_gaussians: MakeGaussians, form: str) -> None:
    scene = in_float64(weighted_scene(make_gaussians(count=5, sh_degree=1, seed=3, size=0.3), form))
    image = drawn("reference", scene, camera)
    weights = weights_of(image)
    gradient = shared("reference").backward(image, **weights)

    def loss(moved: SortFreeScene) -> float:
        seen = drawn("reference", moved, camera)
        return float(sum(np.sum(getattr(seen, name) * weight) for name, weight in weights.items()))

    analytic = {name: getattr(gradient.gaussians, name) for name in ("means", "log_scales", "opacity_logits", "sh")}
    analytic |= {"log_shared": gradient.log_shared, "visibility_sh": gradient.visibility_sh}
    for name, found in analytic.items():
        indices = list(np.ndindex(found.shape))
        for pick in np.random.default_rng(9).permutation(len(indices))[:5]:
            values = []
            for step in (1e-6, -1e-6):
                moved = copied(scene)
                owner: Any = moved if name in ("log_shared", "visibility_sh") else moved.gaussians
                getattr(owner, name)[indices[pick]] += step
                values.append(loss(moved))
            expected = (values[0] - values[1]) / 2e-6
            assert abs(found[indices[pick]] - expected) < 1e-5 * np.abs(found).max() + 1e-6, (name, indices[pick])


@pytest.mark.parametrize("engine", ["cpu", "webgpu"])
@every_form
def test_engines_agree_with_the_reference(
    request: pytest.FixtureRequest, camera: Camera, make_gaussians: MakeGaussians, form: str, engine: str
) -> None:
    if engine == "webgpu":
        request.getfixturevalue("adapter")
    scene = weighted_scene(make_gaussians(count=80, sh_degree=1), form)
    found, expected = drawn(engine, scene, camera), drawn("reference", in_float64(scene), camera)
    for name in ("rgb", "alpha"):
        assert np.mean(np.abs(getattr(found, name) - getattr(expected, name)) > 2e-3) < 0.01, name
    d_found, d_expected = (
        shared(one).backward(image, **weights_of(expected)) for one, image in ((engine, found), ("reference", expected))
    )
    for name in ("means", "log_scales", "rotations", "opacity_logits", "sh"):
        one, other = getattr(d_found.gaussians, name), getattr(d_expected.gaussians, name)
        assert np.quantile(np.abs(one - other), 0.98) < 1e-2 * np.abs(other).max(), name
    np.testing.assert_allclose(d_found.log_shared, d_expected.log_shared, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("lens", [Lens(), Lens("fisheye", (-0.15, 0.0, 0.0, 0.0))], ids=["pinhole", "fisheye"])
def test_kernels_see_what_the_reference_sees(make_gaussians: MakeGaussians, lens: Lens) -> None:
    """Also beside the image, close to the camera and behind it, and of what is faint, diverged or no number."""
    camera = replace(camera_in_front(40, 20, 12.0), lens=lens)
    scene = weighted_scene(make_gaussians(count=300, sh_degree=0), "visibility")
    gaussians = scene.gaussians
    gaussians.means *= 4.0
    gaussians.opacity_logits[::5] = -6.0
    gaussians.log_scales[50:60, 2] = 2.0
    gaussians.means[0], gaussians.sh[1], gaussians.sh[2, 0, 1], gaussians.log_scales[3, 1] = np.nan, np.inf, -1e6, 1e3
    scene.visibility_sh[4] = np.nan
    found = kernels.appearance_of(scene, camera, 1.0, 2)
    expected = appearance.appearance_of(in_float64(scene), camera, 1.0)
    drawn = expected.drawn
    assert drawn[5:].any()
    assert not drawn[:5].any()
    assert 0.1 < expected.in_image[drawn].mean() < 0.9
    np.testing.assert_array_equal(found.drawn, drawn)
    np.testing.assert_array_equal(found.in_image, expected.in_image)
    np.testing.assert_allclose(found.lengths[drawn], expected.lengths[drawn], rtol=1e-5)
    for name in ("depths", "colours", "visibility", "sizes"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-4, atol=1e-4, err_msg=name)


@every_form
def test_fused_passes_draw_what_the_reference_draws(
    adapter: None, camera: Camera, make_gaussians: MakeGaussians, form: str
) -> None:
    """From weights and colours that the GPU makes itself; and with the scene turned round, where no order counts."""
    scene = weighted_scene(make_gaussians(count=300, sh_degree=1), form)
    expected = drawn("reference", in_float64(scene), camera)
    backwards = np.arange(300)[::-1]
    other = replace(scene, gaussians=scene.gaussians.select(backwards), visibility_sh=scene.visibility_sh[backwards])
    with_depth = form == "visibility"
    first = drawing_of(scene, GPU).render(camera, BACKGROUND, depth=with_depth)
    second = drawing_of(other, GPU).render(camera, BACKGROUND)
    for found, wanted in ((first.image, expected.rgb), (first.alpha, expected.alpha), (first.depth, expected.depth)):
        if found is None:
            assert not with_depth
            continue
        assert wanted is not None
        assert np.mean(np.abs(found - wanted) > 2e-3) < 0.005
        assert np.abs(found - wanted).mean() < 2e-4
    np.testing.assert_allclose(first.image, second.image, atol=2e-5)


@pytest.mark.parametrize("form", ["mobile", "visibility"])
def test_fused_passes_keep_to_the_bounds_of_weights(
    adapter: None, camera: Camera, make_gaussians: MakeGaussians, form: str
) -> None:
    scene = weighted_scene(make_gaussians(count=40, sh_degree=1), form)
    scene.gaussians.means[0] = camera.centre + 0.03 * camera.forward
    scene.gaussians.log_scales[0] = 1.0
    scene.gaussians.means[1] = camera.centre
    scene.gaussians.means[2], scene.gaussians.sh[3] = np.nan, np.inf
    scene.visibility_sh[4], scene.visibility_sh[5], scene.visibility_sh[6] = 1e6, -1e6, np.nan
    image = drawing_of(scene, GPU).render(camera, BACKGROUND).image
    assert np.mean(np.abs(image - drawn("cpu", scene, camera).rgb) > 2e-3) < 0.01
    everything_behind = replace(scene, gaussians=replace(scene.gaussians, means=scene.gaussians.means * 0 + 1e3))
    np.testing.assert_allclose(
        drawing_of(everything_behind, GPU).render(camera, BACKGROUND).image,
        np.broadcast_to(BACKGROUND, image.shape),
        atol=1e-6,
    )


def test_fused_passes_keep_to_the_memory_that_they_may_take(
    adapter: None, camera: Camera, make_gaussians: MakeGaussians
) -> None:
    drawing = drawing_of(weighted_scene(make_gaussians(), "lc"), replace(GPU, max_memory=1))
    with pytest.raises(PocketGSError, match=r"would take \d MB of GPU memory, the limit is 1 MB"):
        drawing.render(camera)


def test_a_view_that_does_not_fit_leaves_room_for_others(adapter: None, make_gaussians: MakeGaussians) -> None:
    scene = make_gaussians(count=3000)
    scene.log_scales += 2.0
    drawing = drawing_of(weighted_scene(scene, "lc"), replace(GPU, max_memory=10))
    small = camera_in_front(32, 32, 32.0, 3.0)
    before = drawing.render(small, BACKGROUND).image
    with pytest.raises(PocketGSError, match="the limit is 10 MB"):
        drawing.render(camera_in_front(512, 512, 512.0, 3.0), BACKGROUND)
    np.testing.assert_array_equal(drawing.render(small, BACKGROUND).image, before)


def test_a_view_that_fills_the_gpu_leaves_room_for_others(
    adapter: None, make_gaussians: MakeGaussians, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though some buffers have been made anew by then."""
    drawing = drawing_of(weighted_scene(make_gaussians(), "lc"), GPU)
    assert isinstance(drawing, WeightedDrawing)
    small = camera_in_front(32, 32, 32.0, 3.0)
    before = drawing.render(small, BACKGROUND).image
    device = drawing._executor.device
    create_buffer = device.create_buffer

    def create_if_small(**given: Any) -> Any:
        if given["label"] == "image":
            raise wgpu.GPUOutOfMemoryError("full")
        return create_buffer(**given)

    with monkeypatch.context() as patched:
        patched.setattr(device, "create_buffer", create_if_small)
        with pytest.raises(PocketGSError, match="the GPU is out of memory"):
            drawing.render(camera_in_front(128, 128, 128.0, 3.0), BACKGROUND)
    np.testing.assert_array_equal(drawing.render(small, BACKGROUND).image, before)


def test_names_of_weights_in_the_shaders_are_those_of_forms() -> None:
    assert get_args(Weights) == get_args(FormName)
    assert {name: form.covers for name, form in FORMS.items()} == {
        name: section == "weighted.by_transmittance" for name, section in COVERAGES.items()
    }
    shader = describe_rendering(Variant(weights="mobile")).shaders["project"].source
    assert f"LARGEST_EXPONENT: f32 = {LARGEST_EXPONENT}" in shader


def test_no_order_matters(camera: Camera, make_gaussians: MakeGaussians) -> None:
    scene = weighted_scene(make_gaussians(count=300, sh_degree=1), "visibility")
    shuffle = np.random.default_rng(0).permutation(300)
    other = replace(scene, gaussians=scene.gaussians.select(shuffle), visibility_sh=scene.visibility_sh[shuffle])
    one, two = (drawn("cpu", each, camera) for each in (scene, other))
    np.testing.assert_allclose(one.rgb, two.rgb, atol=1e-5)


@every_form
def test_one_gaussian_alone_has_its_colour_whatever_its_weight(camera: Camera, form: str) -> None:
    """As it has where images are sorted, but where the background takes part by weight."""
    gaussians = Gaussians([[0.0, 0, 0]], np.full((1, 3), -0.5), [[1.0, 0, 0, 0]], [4.0], np.full((1, 1, 3), 0.8))
    image = drawn("cpu", weighted_scene(gaussians, form), camera)
    colour = 0.5 + 0.8 * 0.28209479
    row, column = np.unravel_index(image.alpha.argmax(), image.alpha.shape)
    alpha = image.alpha[row, column]
    np.testing.assert_allclose(image.rgb[row, column], alpha * colour + (1 - alpha) * np.array(BACKGROUND), atol=1e-5)


@pytest.mark.parametrize("form", ["mobile", "visibility", "lc", "exponential"])
def test_weights_past_all_bounds_leave_images_and_gradients_finite(
    camera: Camera, make_gaussians: MakeGaussians, form: str
) -> None:
    scene = weighted_scene(make_gaussians(count=40, sh_degree=1), form)
    scene.gaussians.means[0] = camera.centre + 0.03 * camera.forward
    scene.gaussians.log_scales[0] = 1.0
    scene.gaussians.means[1] = camera.centre
    scene.gaussians.means[2], scene.gaussians.sh[3] = np.nan, np.inf
    if scene.visibility_sh.size:
        scene.visibility_sh[4], scene.visibility_sh[5] = 1e6, -1e6
    image = drawn("cpu", scene, camera)
    gradient = shared("cpu").backward(image, **weights_of(image))
    assert np.isfinite(image.rgb).all()
    drawn_rows = np.setdiff1d(np.arange(40), [2, 3])
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        assert np.isfinite(getattr(gradient.gaussians, name)[drawn_rows]).all(), name
    assert np.isfinite(gradient.log_shared).all()
    assert np.isfinite(gradient.visibility_sh).all()


def test_a_floater_beside_the_image_changes_nothing(camera: Camera, make_gaussians: MakeGaussians) -> None:
    scene = replace(weighted_scene(make_gaussians(count=40, sh_degree=1), "visibility"), log_shared=np.log([30.0]))
    scene.gaussians.log_scales[0] = -6.0
    beside = 0.1 * camera.forward + 0.4 * camera.world_to_camera[0, :3]
    images, gradients = [], []
    for place in (camera.centre - camera.forward, camera.centre + beside):
        scene.gaussians.means[0] = place
        image = shared("cpu").forward(scene, camera, BACKGROUND, near=0.01)
        images.append(image.rgb)
        gradients.append(shared("cpu").backward(image, rgb=np.ones_like(image.rgb)).visibility_sh)
    np.testing.assert_allclose(images[0], images[1], atol=1e-6)
    np.testing.assert_allclose(gradients[0], gradients[1], atol=1e-4)
    assert np.abs(gradients[1]).max() > 0.1


def test_cutting_an_exponent_changes_nothing_that_float32_can_show(
    monkeypatch: pytest.MonkeyPatch, camera: Camera, make_gaussians: MakeGaussians
) -> None:
    scene = weighted_scene(make_gaussians(count=40, sh_degree=0), "mobile")
    scene.gaussians.means[0] = camera.centre + 0.05 * camera.forward
    scene.gaussians.log_scales[0] = np.log(0.05 * (LARGEST_EXPONENT + 20.0))
    expected = drawn("reference", in_float64(scene), camera)
    monkeypatch.setattr("pocketgs.sort_free.forms.LARGEST_EXPONENT", 300.0)
    uncut = drawn("reference", in_float64(scene), camera)
    np.testing.assert_allclose(expected.rgb, uncut.rgb, atol=1e-7)


def test_mistakes_are_named(make_gaussians: MakeGaussians) -> None:
    with pytest.raises(PocketGSError, match="form 'sorted': not known, expected one of direct, exponential, lc"):
        sort_free(make_gaussians(count=3), "sorted", 1.0)
    scene = sort_free(make_gaussians(count=3), "lc", 1.0)
    with pytest.raises(PocketGSError, match=r"views of shape \(3, 2\)"):
        replace(scene, visibility_sh=np.zeros((3, 2), np.float32))
