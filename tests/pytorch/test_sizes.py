"""Sizes of images and tiles, as callers give them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.torch import (
    ClusterCuller,
    Projection,
    TileBinner,
    fully_fused_projection,
    isect_offset_encode,
    isect_tiles,
    proj,
    quat_scale_to_covar_preci,
    rasterization,
    rasterize_to_pixels,
    world_to_cam,
)


@pytest.mark.parametrize("tile_size", [1, 8, 20, 64])
@pytest.mark.parametrize("packed", [False, True])
def test_images_in_double_precision_do_not_depend_on_tiles(
    make_scene: Callable[..., Any], tile_size: int, packed: bool
) -> None:
    found = []
    for side in (16, tile_size):
        scene = make_scene(cameras=2, double=True)
        image, alpha, meta = rasterization(**scene, width=50, height=37, tile_size=side, packed=packed)
        (image.square().sum() + alpha.sum()).backward()
        found.append([image, alpha, *(scene[name].grad for name in ("means", "scales", "colors", "viewmats"))])
    assert meta["isect_offsets"].shape == (2, -(-37 // tile_size), -(-50 // tile_size))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize(("dtype", "tile_size"), [(torch.float32, 8), (torch.float32, 0), (torch.float64, 0)])
def test_tiles_of_other_sizes_are_refused(dtype: torch.dtype, tile_size: int) -> None:
    splats = [torch.zeros(1, 5, *shape, dtype=dtype) for shape in ((2,), (3,), (3,), ())]
    lists = (torch.zeros(1, 3, 4, dtype=torch.int32), torch.zeros(0, dtype=torch.int32))
    with pytest.raises(PocketGSError, match=f"tile_size: found {tile_size}, expected "):
        rasterize_to_pixels(*splats, 50, 37, tile_size, *lists)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("grid", [(1, 1), (4, 3), (3, 5)])
def test_lists_for_another_grid_of_tiles_are_refused(dtype: torch.dtype, grid: tuple[int, int]) -> None:
    splats = [torch.zeros(1, 5, *shape, dtype=dtype) for shape in ((2,), (3,), (3,), ())]
    lists = (torch.zeros(1, *grid, dtype=torch.int32), torch.zeros(0, dtype=torch.int32))
    with pytest.raises(PocketGSError, match="isect_offsets: found "):
        rasterize_to_pixels(*splats, 50, 37, 16, *lists)


def every_function(scene: dict[str, Tensor], width: Any, height: Any, side: Any) -> list[Any]:
    """Results of all functions that take sizes."""
    gaussians = [scene[name] for name in ("means", "quats", "scales")]
    cameras = (scene["viewmats"], scene["Ks"])
    image, alpha, meta = rasterization(**scene, width=width, height=height, tile_size=side, packed=False)
    radii, centres, depths, conics, _ = fully_fused_projection(
        gaussians[0], None, *gaussians[1:], *cameras, width, height
    )
    local = world_to_cam(gaussians[0], quat_scale_to_covar_preci(*gaussians[1:])[0], cameras[0])
    intersections = isect_tiles(centres, radii, depths, side, width // side, height // side)
    offsets = isect_offset_encode(intersections[1], side // 16, width // side, height // side)
    splats = (centres, conics, scene["colors"][None], scene["opacities"][None])
    drawn = rasterize_to_pixels(*splats, width, height, side, offsets, intersections[2])
    tiles = TileBinner.apply(centres, conics, splats[3], depths, [0, len(gaussians[0])], width, height)
    clusters = ClusterCuller.apply(gaussians[0], gaussians[2], cameras[0][0], cameras[1][0], width, height, 0.01)
    settings = Projection(width, height)
    sizes = [settings.width, settings.height, tiles.width, tiles.height, meta["height"], meta["tile_size"]]
    assert all(type(size) is int for size in sizes)
    placed = proj(*local, cameras[1], width, height)
    return [image, alpha, radii, centres, *placed, *intersections, offsets, *drawn, clusters, *sizes]


@pytest.mark.parametrize("kind", [torch.tensor, np.int64])
def test_sizes_may_be_tensors(make_scene: Callable[..., Any], kind: Callable[[int], Any]) -> None:
    scene = {name: tensor.detach() for name, tensor in make_scene().items()}
    expected = every_function(scene, 64, 48, 16)
    found = every_function(scene, *(kind(size) for size in (64, 48, 16)))
    for one, other in zip(found, expected, strict=True):
        assert torch.equal(torch.as_tensor(one), torch.as_tensor(other))


def test_sizes_that_are_no_integers_are_refused(make_scene: Callable[..., Any]) -> None:
    for wrong in (50.0, torch.tensor(50.0), torch.tensor([50, 50]), None):
        with pytest.raises(PocketGSError, match=r"width: found .*, expected an integer"):
            rasterization(**make_scene(), width=wrong, height=37)


def test_settings_become_the_types_that_kernels_are_compiled_for(make_scene: Callable[..., Any]) -> None:
    whole, real = torch.tensor(48), torch.tensor(1.0)
    for made in (Projection(whole, whole, *4 * [real]), Projection(48, 48, 1, 1, 1, 1)):
        assert [type(size) for size in (made.width, made.height)] == 2 * [int]
        assert [type(each) for each in (made.eps2d, made.near_plane, made.far_plane, made.radius_clip)] == 4 * [float]
    scene = make_scene(sh_degree=1)
    expected, *_ = rasterization(**scene, width=50, height=37, sh_degree=1, near_plane=0.5)
    found, *_ = rasterization(**scene, width=50, height=37, sh_degree=torch.tensor(1), near_plane=torch.tensor(0.5))
    assert torch.equal(found, expected)


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("sh_degree", [None, 1])
def test_no_cameras_and_no_batches_are_no_images(
    make_scene: Callable[..., Any], double: bool, packed: bool, sh_degree: int | None
) -> None:
    scene = make_scene(double=double, sh_degree=sh_degree)
    without_cameras = {**scene, "viewmats": scene["viewmats"][:0], "Ks": scene["Ks"][:0]}
    without_batches = {name: tensor[None][:0] for name, tensor in scene.items()}
    for given, lead in ((without_cameras, (0,)), (without_batches, (0, 1))):
        backgrounds = torch.ones(*lead, 3, dtype=scene["means"].dtype)
        options = {"packed": packed, "sh_degree": sh_degree, "backgrounds": backgrounds, "render_mode": "RGB+ED"}
        image, alpha, meta = rasterization(**given, width=50, height=37, **options)
        assert image.shape == (*lead, 37, 50, 4)
        assert alpha.shape == (*lead, 37, 50, 1)
        assert meta["isect_offsets"].shape == (*lead, 3, 4)
        image.sum().backward()
        assert not scene["means"].grad.any()
