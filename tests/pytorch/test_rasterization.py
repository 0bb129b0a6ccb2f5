"""The behaviour of `rasterization` apart from images and gradients."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.torch import (
    TileBinner,
    TileRasterizer,
    fully_fused_projection,
    quat_scale_to_covar_preci,
    rasterization,
    rasterize_to_pixels,
)
from pocketgs.torch.arrays import array_of

SIZE = {"width": 50, "height": 37}
META = {
    "batch_ids",
    "camera_ids",
    "gaussian_ids",
    "radii",
    "means2d",
    "depths",
    "conics",
    "opacities",
    "tile_width",
    "tile_height",
    "tiles_per_gauss",
    "isect_ids",
    "flatten_ids",
    "isect_offsets",
    "width",
    "height",
    "tile_size",
    "n_batches",
    "n_cameras",
}


@pytest.mark.parametrize("options", [{}, {"rasterize_mode": "antialiased"}, {"camera_model": "fisheye"}])
def test_gradcheck_in_double_precision(make_scene: Callable[..., Any], options: dict[str, Any]) -> None:
    scene = make_scene(4, double=True)
    with torch.no_grad():
        # Wide and far from the borders where α falls to 1/255, at which no difference quotient is the gradient.
        scene["scales"] += 0.5
        scene["opacities"] *= 0.6
    Ks = scene.pop("Ks") * Ks_of_a_small_image()
    backgrounds = torch.rand(1, 3, dtype=torch.float64).requires_grad_()

    def render(*tensors: Tensor) -> Tensor:
        names = dict(zip([*scene, "backgrounds"], tensors, strict=True))
        image, alpha, _ = rasterization(**names, Ks=Ks, width=6, height=5, render_mode="RGB+ED", **options)
        return torch.cat([image, alpha], -1)

    assert torch.autograd.gradcheck(render, (*scene.values(), backgrounds), eps=1e-5, atol=1e-4, rtol=1e-3)


def Ks_of_a_small_image() -> Tensor:  # noqa: N802 - gsplat's name
    return torch.tensor([[0.12, 1.0, 0.12], [1.0, 0.12, 0.12], [1.0, 1.0, 1.0]], dtype=torch.float64)


@pytest.mark.parametrize("packed", [False, True])
def test_meta_has_every_key_and_centres_get_gradients(make_scene: Callable[..., Any], packed: bool) -> None:
    scene = make_scene(cameras=2)
    image, _, meta = rasterization(**scene, **SIZE, packed=packed, absgrad=True)
    assert set(meta) == META
    assert "isect_ids" in meta
    assert all(value is not None for name, value in meta.items() if packed or not name.endswith("_ids"))
    rows = (len(meta["gaussian_ids"]),) if packed else (2, len(scene["means"]))
    assert meta["means2d"].shape == meta["radii"].shape == (*rows, 2)
    assert meta["conics"].shape == (*rows, 3)
    assert meta["depths"].shape == meta["opacities"].shape == rows
    meta["means2d"].retain_grad()
    image.square().sum().backward()
    gradient, magnitudes = meta["means2d"].grad, meta["means2d"].absgrad
    assert gradient.shape == magnitudes.shape == (*rows, 2)
    assert gradient.abs().sum() > 0.0
    assert (magnitudes * 1.001 >= gradient.abs() - 1e-6).all()


@pytest.mark.parametrize("copied", [dict, lambda meta: {**meta}, lambda meta: meta | {}])
def test_copies_of_meta_hold_every_value(make_scene: Callable[..., Any], copied: Callable[..., Any]) -> None:
    """Including lazily computed values."""
    _, _, meta = rasterization(**make_scene(5), **SIZE, packed=True)
    found = copied(meta)
    assert set(found) == META
    assert all(value is not None for value in found.values())
    assert meta.pop("isect_ids") is found["isect_ids"]


def saved(meta: dict[str, Any]) -> Any:
    """Meta after `torch.save` and `torch.load`."""
    file = io.BytesIO()
    torch.save(meta, file)
    file.seek(0)
    return torch.load(file)


@pytest.mark.parametrize("copied", [copy.copy, saved, lambda meta: pickle.loads(pickle.dumps(meta))])
def test_saved_meta_holds_every_value(make_scene: Callable[..., Any], copied: Callable[..., Any]) -> None:
    _, _, meta = rasterization(**make_scene(5), **SIZE, packed=True)
    found = copied(meta)
    assert set(found) == META
    assert torch.equal(found["isect_offsets"], meta["isect_offsets"])
    assert found["width"] == 50


def test_batches_are_scenes_of_their_own(make_scene: Callable[..., Any]) -> None:
    scenes = [make_scene(cameras=2, sh_degree=1, seed=seed) for seed in (0, 1)]
    together = {name: torch.stack([scene[name].detach() for scene in scenes]).requires_grad_() for name in scenes[0]}
    image, alpha, meta = rasterization(**together, **SIZE, sh_degree=1, packed=False)
    assert image.shape == (2, 2, 37, 50, 3)
    assert meta["n_batches"] == 2
    packed, _, _ = rasterization(**together, **SIZE, sh_degree=1, packed=True)
    assert torch.equal(packed, image)
    (image.sum() + alpha.sum()).backward()
    for number, scene in enumerate(scenes):
        own, own_alpha, _ = rasterization(**scene, **SIZE, sh_degree=1)
        assert torch.equal(own, image[number])
        (own.sum() + own_alpha.sum()).backward()
        for name in ("means", "quats", "scales", "opacities", "colors", "viewmats"):
            torch.testing.assert_close(together[name].grad[number], scene[name].grad, msg=name)


def test_colours_of_each_camera(make_scene: Callable[..., Any]) -> None:
    scene = make_scene(cameras=2)
    shared, _, _ = rasterization(**scene, **SIZE)
    scene["colors"] = torch.stack([scene["colors"], 2.0 * scene["colors"]])
    for packed in (False, True):
        image, _, _ = rasterization(**scene, **SIZE, packed=packed)
        torch.testing.assert_close(image[0], shared[0])
        torch.testing.assert_close(image[1], 2.0 * shared[1])


@pytest.mark.parametrize("camera_model", ["pinhole", "fisheye"])
def test_sparse_gradients_are_the_dense_ones(make_scene: Callable[..., Any], camera_model: str) -> None:
    dense, sparse = make_scene(cameras=2), make_scene(cameras=2)
    rasterization(**dense, **SIZE, camera_model=camera_model)[0].sum().backward()
    rasterization(**sparse, **SIZE, packed=True, sparse_grad=True, camera_model=camera_model)[0].sum().backward()
    for name in ("means", "quats", "scales"):
        assert sparse[name].grad.is_sparse
        torch.testing.assert_close(sparse[name].grad.to_dense(), dense[name].grad)
    assert not sparse["opacities"].grad.is_sparse


def test_covariances_in_place_of_quaternions_and_scales(make_scene: Callable[..., Any]) -> None:
    from pocketgs.torch import quat_scale_to_covar_preci

    scene = make_scene()
    expected, _, _ = rasterization(**scene, **SIZE)
    covars, _ = quat_scale_to_covar_preci(scene["quats"], scene["scales"])
    found, _, _ = rasterization(**{**scene, "quats": None, "scales": None, "covars": covars}, **SIZE)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-4)
    found.sum().backward()
    assert scene["scales"].grad.abs().sum() > 0.0


def test_pixels_from_the_intersections_that_meta_holds(make_scene: Callable[..., Any]) -> None:
    scene = make_scene(cameras=2)
    for packed in (False, True):
        image, alpha, meta = rasterization(**scene, **SIZE, packed=packed)
        colours = scene["colors"].expand(2, -1, -1)
        colours = colours[meta["camera_ids"], meta["gaussian_ids"]] if packed else colours
        splats = (meta["means2d"], meta["conics"], colours, meta["opacities"])
        lists = (50, 37, 16, meta["isect_offsets"], meta["flatten_ids"])
        found, found_alpha = rasterize_to_pixels(*splats, *lists, packed=packed)
        torch.testing.assert_close(found, image)
        torch.testing.assert_close(found_alpha, alpha)
        masks = torch.ones(2, 3, 4, dtype=torch.bool)
        masks[:, 1, 2] = False
        masked, masked_alpha = rasterize_to_pixels(*splats, *lists, masks=masks, packed=packed)
        assert not masked[:, 16:32, 32:48].any()
        assert torch.equal(masked[:, :, :32], found[:, :, :32])
        assert torch.equal(masked_alpha[:, :16], found_alpha[:, :16])


def test_splats_of_given_lists_that_are_too_faint_add_nothing(make_scene: Callable[..., Any]) -> None:
    scene = make_scene()
    _, _, meta = rasterization(**scene, **SIZE, packed=False)
    lists = (50, 37, 16, meta["isect_offsets"], meta["flatten_ids"])
    shapes, colours = (meta["means2d"], meta["conics"]), scene["colors"][None]
    faint = torch.arange(60) % 2 == 0
    image, alpha = rasterize_to_pixels(*shapes, colours, meta["opacities"] * ~faint, *lists)
    loud, same = rasterize_to_pixels(*shapes, colours + 100.0 * faint[:, None], meta["opacities"] * ~faint, *lists)
    assert alpha.max() > 0.5
    assert torch.equal(image, loud)
    assert torch.equal(alpha, same)


def test_lists_that_do_not_belong_to_the_splats_are_refused(make_scene: Callable[..., Any]) -> None:
    scene = make_scene()
    _, _, meta = rasterization(**scene, **SIZE, packed=False)
    splats = (meta["means2d"], meta["conics"], scene["colors"][None], meta["opacities"])
    for ids in (meta["flatten_ids"] + 1000, meta["flatten_ids"] - 1000, meta["flatten_ids"][:5]):
        with pytest.raises(PocketGSError, match="flatten_ids"):
            rasterize_to_pixels(*splats, 50, 37, 16, meta["isect_offsets"], ids)


def test_results_are_the_same_bits_on_any_number_of_threads(make_scene: Callable[..., Any]) -> None:
    before, found = torch.get_num_threads(), []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        scene = make_scene(900, sh_degree=2)
        image, _, _ = rasterization(**scene, **SIZE, sh_degree=2)
        image.square().sum().backward()
        found.append([image, *(scene[name].grad for name in ("means", "quats", "colors", "viewmats"))])
    torch.set_num_threads(before)
    for one, two in zip(*found, strict=True):
        assert torch.equal(one, two)


def test_kernels_read_the_tensors_own_memory() -> None:
    tensor = torch.rand(5, 3, requires_grad=True)
    assert array_of(tensor).ctypes.data == tensor.data_ptr()


def test_nothing_in_view_is_black_and_has_no_gradient(make_scene: Callable[..., Any]) -> None:
    scene = make_scene()
    with torch.no_grad():
        scene["means"][:, 2] -= 100.0
    for packed in (False, True):
        image, alpha, meta = rasterization(**scene, **SIZE, packed=packed)
        assert not image.any()
        assert not alpha.any()
        assert len(meta["isect_ids"]) == 0
        image.sum().backward()
        assert not scene["means"].grad.any()


@pytest.mark.parametrize("sh_degree", [None, 1])
@pytest.mark.parametrize("double", [False, True])
def test_no_gaussians_are_the_background(make_scene: Callable[..., Any], sh_degree: int | None, double: bool) -> None:
    scene = make_scene(0, sh_degree=sh_degree, cameras=2, double=double)
    behind = torch.full((2, 3), 0.5, dtype=scene["means"].dtype)
    for packed in (False, True):
        options = {"sh_degree": sh_degree, "packed": packed, "render_mode": "RGB+ED"}
        image, alpha, _ = rasterization(**scene, **SIZE, **options, backgrounds=behind)
        assert (image[..., :3] == 0.5).all()
        assert not alpha.any()
        image.sum().backward()
        assert scene["means"].grad.shape == (0, 3)


@pytest.mark.parametrize("double", [False, True])
def test_what_is_no_number_is_not_drawn(make_scene: Callable[..., Any], double: bool) -> None:
    scene, other = make_scene(double=double), make_scene(double=double)
    with torch.no_grad():
        scene["means"][3], scene["scales"][5] = torch.nan, torch.inf
        scene["opacities"][7], scene["opacities"][9] = torch.nan, torch.inf
        other["opacities"][[3, 5, 7, 9]] = 0.0
    image, _, _ = rasterization(**scene, **SIZE)
    expected, _, _ = rasterization(**other, **SIZE)
    assert torch.equal(image, expected)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"with_ut": True}, "with_ut is not supported"),
        ({"with_eval3d": True}, "with_eval3d is not supported"),
        ({"distributed": True}, "distributed is not supported"),
        ({"radial_coeffs": torch.zeros(1, 6)}, "radial_coeffs is not supported"),
        ({"camera_model": "ftheta"}, "camera_model: found 'ftheta'"),
        ({"render_mode": "N"}, "render_mode: found 'N'"),
        ({"rasterize_mode": "mip"}, "rasterize_mode: found 'mip'"),
        ({"opacities": torch.zeros(60, 1)}, r"opacities: found shape \(60, 1\), expected \(60,\)"),
        ({"scales": torch.zeros(60, 3, dtype=torch.float64)}, "scales: found torch.float64"),
        ({"means": torch.zeros(60, 3, dtype=torch.float16)}, "means: found torch.float16"),
        ({"colors": torch.zeros(61, 3)}, "colors: found shape"),
        ({"backgrounds": torch.zeros(3)}, "backgrounds: found shape"),
        ({"sh_degree": 2}, "colors: found shape"),
        ({"sparse_grad": True, "packed": False}, "sparse_grad"),
    ],
)
def test_what_is_wrong_or_unsupported_is_one_error(
    make_scene: Callable[..., Any], wrong: dict[str, Any], message: str
) -> None:
    with pytest.raises(PocketGSError, match=message):
        rasterization(**{**make_scene(), **SIZE, **wrong})


def test_too_high_a_degree_of_harmonics_is_refused(make_scene: Callable[..., Any]) -> None:
    with pytest.raises(PocketGSError, match="degree 2 with 4 coefficients"):
        rasterization(**make_scene(sh_degree=1), **SIZE, sh_degree=2)


def test_bounds_follow_the_opacity(make_scene: Callable[..., Any]) -> None:
    scene = make_scene()
    gaussians = (scene["means"], None, scene["quats"], scene["scales"], scene["viewmats"], scene["Ks"], 50, 37)
    wide, *_ = fully_fused_projection(*gaussians)
    tight, *_ = fully_fused_projection(*gaussians, opacities=torch.full((60,), 0.01))
    assert (tight <= wide).all()
    assert (tight < wide).any()
    none, *_ = fully_fused_projection(*gaussians, opacities=torch.full((60,), 0.003))
    assert not none.any()


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("compensated", [False, True])
def test_bounds_are_where_a_splat_fades_out(make_scene: Callable[..., Any], compensated: bool, double: bool) -> None:
    """Where α is 1/255, of an opacity that makes up for the blur."""
    scene = {name: tensor.detach() for name, tensor in make_scene(double=double).items()}
    scene["scales"] *= torch.logspace(-2.0, 0.0, 60)[:, None]
    radii, _, _, conics, factors = fully_fused_projection(
        *(scene["means"], None, scene["quats"], scene["scales"], scene["viewmats"], scene["Ks"], 50, 37),
        opacities=scene["opacities"],
        calc_compensations=compensated,
    )
    seen = radii.all(-1)
    assert 30 < seen.sum() < 60 if compensated else seen.all()
    xx, xy, yy = conics[seen].unbind(-1)
    variances = torch.stack([yy, xx], -1) / (xx * yy - xy * xy)[:, None]
    opacities = scene["opacities"][seen[0]] * (factors[seen] if compensated else 1.0)
    reach = (2.0 * (255.0 * opacities).log()).sqrt().clamp(max=3.33)
    beyond = radii[seen] - reach[:, None] * variances.sqrt()
    assert beyond.min() > -1e-3
    assert beyond.max() < 1.001


@pytest.mark.parametrize("double", [False, True])
def test_splats_are_clipped_if_both_their_radii_are_small(make_scene: Callable[..., Any], double: bool) -> None:
    scene = make_scene(double=double)
    gaussians = (scene["means"], None, scene["quats"], scene["scales"], scene["viewmats"], scene["Ks"], 50, 37)
    whole, *_ = fully_fused_projection(*gaussians)
    clip = int(whole.median())
    kept = (whole > clip).any(-1, keepdim=True)
    assert kept.any()
    assert ((whole > clip).all(-1, keepdim=True) != kept).any()
    clipped, *_ = fully_fused_projection(*gaussians, radius_clip=float(clip))
    assert torch.equal(clipped, whole * kept)


def test_depths_on_both_sides_of_an_orthographic_camera_are_in_order(make_scene: Callable[..., Any]) -> None:
    """It has no middle that light goes through: moved forwards, it shows the same if its near plane stays."""
    images = []
    for forwards in (0.0, 4.0, 8.0):
        scene = {name: tensor.detach() for name, tensor in make_scene().items()}
        scene["Ks"][:, :2, :2] *= 0.4
        scene["viewmats"][:, 2, 3] -= forwards
        image, *_ = rasterization(**scene, width=50, height=37, camera_model="ortho", near_plane=-10.0)
        images.append(image)
    for image in images[1:]:
        torch.testing.assert_close(image, images[0], rtol=0.0, atol=1e-4)


def test_covariances_of_needles_too_thin_for_float32() -> None:
    """Their conics are no ellipses any more, and would reach tiles that there are not."""
    generator = torch.Generator().manual_seed(0)
    means = torch.rand(20, 3, generator=generator) - 0.5
    means[:, 2] += 4.0
    half = torch.rand(20, generator=generator)
    quats = torch.stack([half.cos(), 0.0 * half, 0.0 * half, half.sin()], -1)
    covars, _ = quat_scale_to_covar_preci(quats, torch.tensor([[300.0, 1e-3, 1e-3]]).repeat(20, 1))
    colours, viewmats = torch.rand(20, 3, generator=generator), torch.eye(4)[None]
    intrinsics = torch.tensor([[[44.0, 0.0, 25.0], [0.0, 44.0, 18.0], [0.0, 0.0, 1.0]]])
    image, alpha, _ = rasterization(
        means, None, None, torch.full((20,), 0.9), colours, viewmats, intrinsics, 50, 37, covars=covars
    )
    assert image.isfinite().all()
    assert (alpha <= 1.0).all()


def test_conics_that_are_hardly_definite_are_not_drawn() -> None:
    """Nearest to the parabola in float32, on its inside."""
    rng = np.random.default_rng(0)
    xx, yy = rng.uniform(0.01, 1.0, (2, 2000)).astype(np.float32)
    xy = np.sqrt(xx.astype(np.float64) * yy).astype(np.float32)
    xy = np.where(xy.astype(np.float64) ** 2 >= xx.astype(np.float64) * yy, np.nextafter(xy, np.float32(0.0)), xy)
    conics = torch.from_numpy(np.stack([xx, xy, yy], -1))
    centres = torch.from_numpy(rng.uniform(0.0, 30.0, (2000, 2)).astype(np.float32))
    opacities = torch.full((2000,), 0.9)
    tiles = TileBinner.apply(centres, conics, opacities, torch.linspace(1.0, 2.0, 2000), [0, 2000], 50, 37)
    image, _ = TileRasterizer.apply(centres, conics, torch.ones(2000, 3), opacities, None, tiles, False)
    assert not image.any()
