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
    compute_relocation,
    fully_fused_projection,
    fused_ssim,
    isect_offset_encode,
    isect_tiles,
    proj,
    quat_scale_to_covar_preci,
    rasterization,
    rasterize_to_pixels,
    spherical_harmonics,
    world_to_cam,
)

SIZE = (50, 37)


def every_function(scene: dict[str, Any]) -> list[tuple[Callable[..., Any], dict[str, Any]]]:
    """Each function of tensors with arguments that it takes."""
    rows, conics, ones = torch.ones(1, 5, 2), torch.ones(1, 5, 3), torch.ones(1, 5)
    lists = (torch.zeros(1, 3, 4, dtype=torch.int32), torch.zeros(0, dtype=torch.int32))
    size = {"width": 50, "height": 37}
    grid = {"tile_size": 16, "tile_width": 4, "tile_height": 3}
    gaussians = {name: scene[name] for name in ("means", "quats", "scales", "viewmats", "Ks")}
    local, covars, image = torch.ones(1, 5, 3), torch.eye(3).expand(1, 5, 3, 3), torch.ones(1, 3, 20, 20)
    pixels = {"means2d": rows, "conics": conics, "colors": conics, "opacities": ones}
    drawn = {"image_width": 50, "image_height": 37, "tile_size": 16}
    return [
        (rasterization, {**scene, **size, "backgrounds": torch.ones(1, 3)}),
        (rasterization, {**scene, **size, "covars": torch.eye(3).expand(60, 3, 3)}),
        (fully_fused_projection, {**gaussians, **size, "covars": None, "opacities": scene["opacities"]}),
        (rasterize_to_pixels, {**pixels, **drawn, "isect_offsets": lists[0], "flatten_ids": lists[1]}),
        (isect_tiles, {"means2d": rows, "radii": rows.int(), "depths": ones, **grid}),
        (isect_offset_encode, {"isect_ids": lists[1].long(), "n_images": 1, "tile_width": 4, "tile_height": 3}),
        (spherical_harmonics, {"degrees_to_use": 1, "dirs": conics, "coeffs": torch.ones(1, 5, 4, 3)}),
        (quat_scale_to_covar_preci, {"quats": torch.ones(5, 4), "scales": torch.ones(5, 3)}),
        (world_to_cam, {"means": local[0], "covars": covars[0], "viewmats": torch.eye(4)[None]}),
        (proj, {"means": local, "covars": covars, "Ks": torch.eye(3)[None], **size}),
        (fused_ssim, {"img1": image, "img2": image}),
        (
            compute_relocation,
            {"opacities": ones[0], "scales": conics[0], "ratios": torch.ones(5), "binoms": torch.ones(9, 9)},
        ),
    ]


@pytest.mark.parametrize("place", range(12))
def test_what_is_no_tensor_or_lacks_dimensions_is_named(make_scene: Callable[..., Any], place: int) -> None:
    """NumPy arrays, lists and numbers, and tensors of one number."""
    function, arguments = every_function(make_scene())[place]
    function(**arguments)
    tensors = {name: tensor for name, tensor in arguments.items() if isinstance(tensor, torch.Tensor)}
    for name, tensor in tensors.items():
        for wrong, found in (
            (tensor.detach().numpy(), "numpy.ndarray, expected a tensor"),
            (tensor.tolist(), "list, expected a tensor"),
            (1.0, "float, expected a tensor"),
            (torch.tensor(1.0), r"shape \(\), expected at least [1-4] dimensions?"),
        ):
            with pytest.raises(PocketGSError, match=f"^{name}: found {found}$"):
                function(**{**arguments, name: wrong})


@pytest.mark.parametrize(
    ("name", "shape", "expected"),
    [
        ("viewmats", (4, 4), "at least 3 dimensions"),
        ("Ks", (3, 3), "at least 3 dimensions"),
        ("means", (3,), "at least 2 dimensions"),
        ("colors", (60,), "at least 2 dimensions"),
        ("colors", (), "at least 2 dimensions"),
        ("quats", (60, 3), r"\(60, 4\)"),
    ],
)
def test_common_mistakes_with_shapes(
    make_scene: Callable[..., Any], name: str, shape: tuple[int, ...], expected: str
) -> None:
    scene = {**make_scene(), name: torch.ones(shape)}
    with pytest.raises(PocketGSError, match=f"{name}: found shape .*, expected {expected}$"):
        rasterization(**scene, width=50, height=37)


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
        ({"sh_degree": 1.0, "colors": torch.zeros(60, 4, 3)}, "sh_degree: found 1.0, expected an integer"),
        ({"colors": torch.zeros(60, 0)}, "colors: found no channels"),
        ({"Ks": torch.ones(1, 3, 3, device="meta")}, "Ks: found a tensor on meta, expected one on the CPU"),
        ({"means": torch.ones(60, 3, device="meta")}, "means: found a tensor on meta, expected one on the CPU"),
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
