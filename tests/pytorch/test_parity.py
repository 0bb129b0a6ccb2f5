"""Images and gradients agree with gsplat's PyTorch reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from gsplat.cuda import _torch_impl
from torch import Tensor

from pocketgs.torch import (
    fully_fused_projection,
    isect_offset_encode,
    isect_tiles,
    proj,
    quat_scale_to_covar_preci,
    rasterization,
    spherical_harmonics,
    world_to_cam,
)
from pytorch import gsplat_reference

SIZE = (50, 37)
TRAINED = ("means", "quats", "scales", "opacities", "colors", "viewmats")
MODELS = ("pinhole", "ortho", "fisheye")


def assert_close(found: Tensor, expected: Tensor, within: float, what: str = "") -> None:
    worst = (found - expected).abs().max() / expected.abs().max().clamp(min=1e-12)
    assert worst < within, f"{what}: {worst:.2e}"


def compare(scene: dict[str, Tensor], **options: Any) -> None:
    """Compare images to within 1e-4, and gradients to within 1e-3 of the largest."""
    ours, theirs = scene, {name: tensor.detach().double().requires_grad_() for name, tensor in scene.items()}
    if options.get("camera_model") == "ortho":
        for each in (ours, theirs):
            each["Ks"] = each["Ks"].detach() * each["Ks"].new_tensor([0.4, 0.4, 1.0])[:, None].expand(3, 3).clamp(
                max=1.0
            )
    packed = options.pop("packed", False)
    image, alpha, _ = rasterization(**ours, width=SIZE[0], height=SIZE[1], packed=packed, **options)
    for name, value in options.items():
        options[name] = value.double() if isinstance(value, Tensor) else value
    expected_image, expected_alpha, _ = gsplat_reference.rasterization(
        **theirs, width=SIZE[0], height=SIZE[1], **options
    )
    assert image.shape == expected_image.shape
    assert_close(image, expected_image, 1e-4, "image")
    assert_close(alpha, expected_alpha, 1e-4, "alpha")
    generator = torch.Generator().manual_seed(1)
    weights = [torch.rand(each.shape, generator=generator) for each in (image, alpha)]
    ((image * weights[0]).sum() + (alpha * weights[1]).sum()).backward()
    ((expected_image * weights[0]).sum() + (expected_alpha * weights[1]).sum()).backward()
    for name in TRAINED:
        expected = theirs[name].grad
        if expected is None or not expected.any():
            assert ours[name].grad is None or not ours[name].grad.any(), name
        else:
            assert_close(ours[name].grad, expected, 1e-3, name)


@pytest.mark.parametrize("render_mode", ["RGB", "D", "ED", "RGB+D", "RGB+ED"])
@pytest.mark.parametrize("packed", [False, True])
def test_every_render_mode(make_scene: Callable[..., Any], render_mode: str, packed: bool) -> None:
    compare(make_scene(sh_degree=3, cameras=2), sh_degree=3, render_mode=render_mode, packed=packed)


@pytest.mark.parametrize("camera_model", MODELS)
@pytest.mark.parametrize("rasterize_mode", ["classic", "antialiased"])
def test_every_camera_model(make_scene: Callable[..., Any], camera_model: str, rasterize_mode: str) -> None:
    compare(make_scene(), camera_model=camera_model, rasterize_mode=rasterize_mode)


@pytest.mark.parametrize("rasterize_mode", ["classic", "antialiased"])
def test_any_blur(make_scene: Callable[..., Any], rasterize_mode: str) -> None:
    compare(make_scene(), eps2d=1.5, rasterize_mode=rasterize_mode)


@pytest.mark.parametrize("channels", [1, 4, 40])
def test_any_number_of_channels_over_a_background(make_scene: Callable[..., Any], channels: int) -> None:
    backgrounds = torch.rand(2, channels, generator=torch.Generator().manual_seed(5))
    compare(make_scene(channels=channels, cameras=2), backgrounds=backgrounds, packed=channels == 4)


def test_opaque_gaussians_stop_where_gsplats_do(make_scene: Callable[..., Any]) -> None:
    """Forty nearly opaque Gaussians in a row: one that would bring a pixel to 1e-4 is skipped, with all behind it."""
    scene = make_scene(200)
    with torch.no_grad():
        scene["opacities"].fill_(1.0)
        scene["scales"].mul_(2.0)
    compare(scene)


@pytest.mark.parametrize("camera_model", MODELS)
@pytest.mark.parametrize("packed", [False, True])
def test_projection(make_scene: Callable[..., Any], camera_model: str, packed: bool) -> None:
    scene = make_scene(300, cameras=2)
    with torch.no_grad():
        scene["means"][:100] *= 4.0  # beside the image, behind the camera, before the near plane
    covars, _ = _torch_impl._quat_scale_to_covar_preci(scene["quats"], scene["scales"], True, False)
    cameras = (scene["viewmats"], scene["Ks"], *SIZE)
    options = {"near_plane": 2.0, "far_plane": 9.0, "calc_compensations": True, "camera_model": camera_model}
    radii, *expected = _torch_impl._fully_fused_projection(scene["means"], covars, *cameras, **options)
    gaussians = (scene["means"], None, scene["quats"], scene["scales"])
    *ids, found_radii, means2d, depths, conics, compensations = fully_fused_projection(
        *gaussians, *cameras, packed=packed, **options
    )
    seen = (radii > 0).all(-1)
    assert 0 < seen.sum() < seen.numel()
    if packed:
        places = torch.nonzero(seen)
        assert torch.equal(ids[1], places[:, 0])
        assert torch.equal(ids[2], places[:, 1])
    rows = slice(None) if packed else seen
    assert torch.equal(found_radii[rows], radii[seen])
    assert packed or not found_radii[~seen].any()
    for name, found, right in zip("mdcf", (means2d, depths, conics, compensations), expected, strict=True):
        assert_close(found[rows], right[seen], 1e-4, name)


def test_building_blocks(make_scene: Callable[..., Any]) -> None:
    scene = make_scene(cameras=2, double=True)
    quats, scales, means = scene["quats"], scene["scales"], scene["means"]
    for triu in (False, True):
        found = quat_scale_to_covar_preci(quats, scales, triu=triu)
        for one, other in zip(found, _torch_impl._quat_scale_to_covar_preci(quats, scales, triu=triu), strict=True):
            assert_close(one, other, 1e-9)
    covars, _ = quat_scale_to_covar_preci(quats, scales)
    found = world_to_cam(means, covars, scene["viewmats"])
    expected = _torch_impl._world_to_cam(means, covars, scene["viewmats"])
    for one, other in zip(found, expected, strict=True):
        assert_close(one, other, 1e-9)
    for model, theirs in zip(
        MODELS, (_torch_impl._persp_proj, _torch_impl._ortho_proj, _torch_impl._fisheye_proj), strict=True
    ):
        for one, other in zip(proj(*found, scene["Ks"], *SIZE, model), theirs(*found, scene["Ks"], *SIZE), strict=True):
            assert_close(one, other, 1e-5)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_harmonics(make_scene: Callable[..., Any], degree: int) -> None:
    scenes = [make_scene(sh_degree=3, double=double) for double in (False, True)]
    found, expected = (
        harmonics(degree, scene["means"], scene["colors"])
        for harmonics, scene in zip((spherical_harmonics, _torch_impl._spherical_harmonics), scenes, strict=True)
    )
    assert_close(found, expected, 1e-5)
    weights = torch.rand(found.shape, generator=torch.Generator().manual_seed(1))
    for values in (found, expected):
        (values * weights).sum().backward()
    for name in ("means", "colors") if degree else ("colors",):
        ours, theirs = (scene[name].grad for scene in scenes)
        assert_close(ours, theirs, 1e-5, name)


def test_intersections(make_scene: Callable[..., Any]) -> None:
    scene = make_scene(cameras=2)
    *_, meta = rasterization(**scene, width=SIZE[0], height=SIZE[1], packed=False)
    splats = (meta["means2d"], meta["radii"], meta["depths"], 16, 4, 3)
    expected = _torch_impl._isect_tiles(*splats)
    for name, found, right in zip(
        ("tiles_per_gauss", "isect_ids", "flatten_ids"), isect_tiles(*splats), expected, strict=True
    ):
        assert torch.equal(found, right), name
        assert torch.equal(found, meta[name]), name
    offsets = isect_offset_encode(expected[1], 2, 4, 3)
    assert torch.equal(offsets, _torch_impl._isect_offset_encode(expected[1], 2, 4, 3))
    assert torch.equal(offsets, meta["isect_offsets"])
