"""Arguments that would be read beyond their end, taken for something else, or fail inside a kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from pocketgs.errors import PocketGSError
from pocketgs.torch import (
    Project2D,
    Projection,
    fully_fused_projection,
    isect_tiles,
    rasterization,
    rasterize_to_pixels,
    spherical_harmonics,
)

SIZE = (50, 37)


@pytest.mark.parametrize("shape", [(1,), (61,), (60, 1), (2, 60)])
@pytest.mark.parametrize("double", [False, True])
def test_opacities_of_another_shape(make_scene: Callable[..., Any], shape: tuple[int, ...], double: bool) -> None:
    scene = make_scene(double=double)
    gaussians = (scene["means"], None, scene["quats"], scene["scales"], scene["viewmats"], scene["Ks"], *SIZE)
    opacities = torch.ones(shape, dtype=scene["means"].dtype)
    with pytest.raises(PocketGSError, match=r"opacities: found shape .*, expected \(60,\)"):
        fully_fused_projection(*gaussians, opacities=opacities)


@pytest.mark.parametrize("name", ["quats", "scales", "opacities", "Ks"])
def test_rows_that_the_projection_would_read_beyond(make_scene: Callable[..., Any], name: str) -> None:
    scene = make_scene(cameras=2)
    scene[name] = scene[name][:-1]
    given = [scene[each] for each in ("means", "quats", "scales", "opacities", "viewmats", "Ks")]
    with pytest.raises(PocketGSError, match=f"{name}: found shape"):
        Project2D.apply(*given, Projection(*SIZE))


def test_opacities_without_the_batches_of_means(make_scene: Callable[..., Any]) -> None:
    scene = {name: tensor.expand(2, *tensor.shape) for name, tensor in make_scene().items()}
    gaussians = (scene["means"], None, scene["quats"], scene["scales"], scene["viewmats"], scene["Ks"], *SIZE)
    with pytest.raises(PocketGSError, match=r"opacities: found shape \(60,\), expected \(2, 60\)"):
        fully_fused_projection(*gaussians, opacities=scene["opacities"][0])


@pytest.mark.parametrize("ids", [[0], [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 1], [-1, 0, 0, 0, 0]])
def test_images_of_rows_that_do_not_exist(ids: list[int]) -> None:
    rows = (torch.full((5, 2), 20.0), torch.full((5, 2), 4, dtype=torch.int32), torch.ones(5))
    with pytest.raises(PocketGSError, match="image_ids: found"):
        isect_tiles(*rows, 16, 4, 3, packed=True, n_images=1, image_ids=torch.tensor(ids))


@pytest.mark.parametrize(
    "masks", [torch.ones(1, 3, 4, dtype=torch.int32), torch.ones(1, 4, 3).bool(), torch.ones(3, 4).bool()]
)
def test_masks_that_are_no_masks_of_the_tiles(masks: torch.Tensor) -> None:
    splats = [torch.zeros(1, 5, *shape) for shape in ((2,), (3,), (3,), ())]
    lists = (torch.zeros(1, 3, 4, dtype=torch.int32), torch.zeros(0, dtype=torch.int32))
    with pytest.raises(PocketGSError, match="masks: found"):
        rasterize_to_pixels(*splats, *SIZE, 16, *lists, masks=masks)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"width": -5}, "width: found -5, expected at least 1"),
        ({"height": 0}, "height: found 0, expected at least 1"),
        ({"tile_size": 0}, "tile_size: found 0, expected at least 1"),
        ({"near_plane": None}, "near_plane: found None, expected a number"),
        ({"eps2d": torch.ones(2)}, "eps2d: found .*, expected a number"),
        ({"sh_degree": 1.0, "colors": torch.zeros(60, 4, 3)}, "sh_degree: found 1, expected an integer"),
        ({"colors": torch.zeros(60, 0)}, "colors: found no channels"),
    ],
)
def test_settings_that_fail_in_kernels(make_scene: Callable[..., Any], wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(PocketGSError, match=message):
        rasterization(**{**make_scene(), "width": 50, "height": 37, **wrong})


def test_other_sizes_and_degrees_that_fail_in_kernels() -> None:
    splats = [torch.zeros(1, 5, *shape) for shape in ((2,), (3,), (0,), ())]
    lists = (torch.zeros(1, 3, 4, dtype=torch.int32), torch.zeros(0, dtype=torch.int32))
    with pytest.raises(PocketGSError, match="colors: found no channels"):
        rasterize_to_pixels(*splats, *SIZE, 16, *lists)
    with pytest.raises(PocketGSError, match="degrees_to_use: found None"):
        spherical_harmonics(None, torch.ones(5, 3), torch.ones(5, 4, 3))  # type: ignore[arg-type]
