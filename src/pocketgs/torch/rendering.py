"""gsplat's `rasterization`: images of Gaussians and cameras, with gradients with respect to both."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, NamedTuple

import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.torch.arrays import check_shape, check_tensors, checked_dtype, whole_numbers
from pocketgs.torch.colours import drawn_colours
from pocketgs.torch.covariance import upper_triangle
from pocketgs.torch.engine import gpu_compositor
from pocketgs.torch.intersections import isect_offset_encode, isect_tiles
from pocketgs.torch.meta import Meta
from pocketgs.torch.pixels import rasterize_to_pixels
from pocketgs.torch.project import Projection
from pocketgs.torch.projection import in_rows, projected
from pocketgs.torch.rasterize import TileRasterizer
from pocketgs.torch.rows import Rows
from pocketgs.torch.tiles import TileBinner
from pocketgs.torch.unsupported import refuse_arguments


class RollingShutterType(Enum):
    """gsplat's kinds of shutters, of which only GLOBAL is supported."""

    ROLLING_TOP_TO_BOTTOM = 0
    ROLLING_LEFT_TO_RIGHT = 1
    ROLLING_BOTTOM_TO_TOP = 2
    ROLLING_RIGHT_TO_LEFT = 3
    GLOBAL = 4


RENDER_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
RASTERIZE_MODES = ("classic", "antialiased")


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int = 16,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,
    covars: Tensor | None = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Tensor | None = None,
    tangential_coeffs: Tensor | None = None,
    thin_prism_coeffs: Tensor | None = None,
    ftheta_coeffs: Any = None,
    rolling_shutter: Any = None,
    viewmats_rs: Tensor | None = None,
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """Render Gaussians into cameras, like gsplat 1.5.3.

        image, alpha, meta = rasterization(means, quats, scales, opacities, colors, viewmats, Ks, 640, 480)

    Args:
        means: (..., N, 3) centres in the world; the dots stand for batch dimensions, which all arguments share.
        quats: (..., N, 4) w, x, y, z of any length.
        scales: (..., N, 3) standard deviations.
        opacities: (..., N) in [0, 1].
        colors: (..., N, D) or (..., C, N, D), any D; with `sh_degree` coefficients (..., N, K, 3) or (..., C, N, K, 3).
        viewmats: (..., C, 4, 4) world_to_camera, in OpenCV's axes.
        Ks: (..., C, 3, 3) intrinsics in pixels; they get no gradient.
        width: of the images.
        height: of the images.
        near_plane: minimum depth of visible Gaussians.
        far_plane: maximum depth.
        radius_clip: Gaussians with radii up to this on the image, in pixels, are not visible.
        eps2d: added to both variances on the image, in pixels².
        sh_degree: maximum degree of the harmonics to use, 0 to 3; None if `colors` are final colours.
        packed: whether `meta` has rows only for visible Gaussians.
        tile_size: of the intersections in `meta`; images do not depend on it.
        backgrounds: (..., C, D) behind the Gaussians, or None for black.
        render_mode: "RGB", the colours; "D", Σ α T z; "ED", that over the alpha; "RGB+D" and "RGB+ED", both.
        sparse_grad: with `packed`, whether gradients of means, quats and scales are sparse.
        absgrad: whether backward stores the magnitudes of the pixels' gradients, summed, in `meta["means2d"].absgrad`.
        rasterize_mode: "classic", or "antialiased", which lowers opacities by as much as `eps2d` increases the area.
        channel_chunk: ignored: any number of channels takes one pass.
        distributed: not supported.
        camera_model: "pinhole", "ortho" or "fisheye".
        segmented: ignored.
        covars: (..., N, 3, 3) instead of quats and scales, or None.
        with_ut: not supported, nor are the following.
        with_eval3d: not supported.
        radial_coeffs: not supported.
        tangential_coeffs: not supported.
        thin_prism_coeffs: not supported.
        ftheta_coeffs: not supported.
        rolling_shutter: not supported.
        viewmats_rs: not supported.

    Returns:
        Images (..., C, H, W, X), alphas (..., C, H, W, 1), and a dictionary of intermediate results. X is D, plus 1 for
        depth, which comes last; 1 for depth alone.

    Raises:
        PocketGSError: shapes or types disagree, or an argument is not supported.
    """
    check_modes(render_mode, rasterize_mode)
    refuse_arguments(
        {
            "distributed": distributed,
            "with_ut": with_ut,
            "with_eval3d": with_eval3d,
            "radial_coeffs": radial_coeffs,
            "tangential_coeffs": tangential_coeffs,
            "thin_prism_coeffs": thin_prism_coeffs,
            "ftheta_coeffs": ftheta_coeffs,
            "rolling_shutter": rolling_shutter,
            "viewmats_rs": viewmats_rs,
        }
    )
    width, height, tile_size = whole_numbers(1, width=width, height=height, tile_size=tile_size)
    check_tensors(1, opacities=opacities)
    check_tensors(2, means=means, colors=colors)
    check_tensors(2, optional=True, quats=quats, scales=scales, backgrounds=backgrounds)
    check_tensors(3, viewmats=viewmats, Ks=Ks)
    check_tensors(3, optional=True, covars=covars)
    dtype = checked_dtype({"means": means, "opacities": opacities, "colors": colors, "backgrounds": backgrounds})
    lead, count, cameras = tuple(means.shape[:-2]), means.shape[-2], viewmats.shape[-3]
    check_shape("opacities", opacities, (*lead, count))
    if covars is not None:
        check_shape("covars", covars, (*lead, count, 3, 3))
    viewmats = viewmats.to(dtype)
    sizes = (eps2d, near_plane, far_plane, radius_clip, rasterize_mode == "antialiased", packed, sparse_grad)
    projection = Projection(width, height, *sizes, camera_model)
    if covars is None:
        splats = projected(means, None, quats, scales, opacities, viewmats, Ks, projection)
    else:
        splats = projected(means, upper_triangle(covars), None, None, opacities, viewmats, Ks, projection)
    rows = Rows(lead, cameras, count, splats.seen, packed)
    means2d, depths, conics, compensations, radii = in_rows(splats, projection, (*lead, cameras, count))
    shown = rows.of_gaussians(opacities[..., None])[..., 0]
    if compensations is not None:
        shown = shown * compensations
    if "RGB" in render_mode:
        colours = drawn_colours(rows, means, colors, viewmats, sh_degree)
        values, behind = with_depths(colours, backgrounds, depths, (*lead, cameras), render_mode)
    else:  # depth alone ignores backgrounds
        values, behind = depths[..., None], None
    meta = described(rows, SplatRows(radii, means2d, conics, shown, depths), width, height, tile_size)
    images, alphas = composited(rows, meta, values, behind, absgrad)
    if "ED" in render_mode:
        images = torch.cat([images[..., :-1], images[..., -1:] / alphas.clamp(min=1e-10)], -1)
    return images, alphas, meta


def check_modes(render_mode: str, rasterize_mode: str) -> None:
    """Check the modes.

    Raises:
        PocketGSError: one is not in RENDER_MODES or RASTERIZE_MODES.
    """
    if render_mode not in RENDER_MODES:
        raise PocketGSError(f"render_mode: found {render_mode!r}, expected one of {', '.join(RENDER_MODES)}")
    if rasterize_mode not in RASTERIZE_MODES:
        raise PocketGSError(f"rasterize_mode: found {rasterize_mode!r}, expected one of {', '.join(RASTERIZE_MODES)}")


def with_depths(
    colours: Tensor, backgrounds: Tensor | None, depths: Tensor, views: tuple[int, ...], render_mode: str
) -> tuple[Tensor, Tensor | None]:
    """Colours and backgrounds with depth as their last channel, if the mode wants it. Behind everything it is 0.

    Raises:
        PocketGSError: backgrounds have another shape than (*views, channels).
    """
    if backgrounds is not None:
        check_shape("backgrounds", backgrounds, (*views, colours.shape[-1]))
    if render_mode == "RGB":
        return colours, backgrounds
    behind = None if backgrounds is None else torch.nn.functional.pad(backgrounds, (0, 1))
    return torch.cat([colours, depths[..., None]], -1), behind


class SplatRows(NamedTuple):
    """Rows of splats: (..., 2) int32 radii, (..., 2) centres, (..., 3) conics, (...) opacities and depths."""

    radii: Tensor
    means2d: Tensor
    conics: Tensor
    opacities: Tensor
    depths: Tensor


def described(rows: Rows, splats: SplatRows, width: int, height: int, tile_size: int) -> Meta:
    """The dictionary of gsplat; indices and tile intersections are computed when they are first used."""
    across, down = math.ceil(width / tile_size), math.ceil(height / tile_size)

    def ids() -> tuple[Tensor | None, ...]:
        return rows.ids or (None, None, None)

    def intersections() -> tuple[Tensor, ...]:
        found = isect_tiles(
            splats.means2d.detach(),
            splats.radii,
            splats.depths.detach(),
            tile_size,
            across,
            down,
            packed=rows.packed,
            n_images=rows.images,
            image_ids=rows.image_ids,
        )
        offsets = isect_offset_encode(found[1], rows.images, across, down)
        return *found, offsets.reshape(*rows.lead, rows.cameras, down, across)

    known = {
        **splats._asdict(),
        "tile_width": across,
        "tile_height": down,
        "width": width,
        "height": height,
        "tile_size": tile_size,
        "n_batches": math.prod(rows.lead),
        "n_cameras": rows.cameras,
    }
    names = ("tiles_per_gauss", "isect_ids", "flatten_ids", "isect_offsets")
    return Meta(known, {("batch_ids", "camera_ids", "gaussian_ids"): ids, names: intersections})


def composited(
    rows: Rows, meta: Meta, values: Tensor, backgrounds: Tensor | None, absgrad: bool
) -> tuple[Tensor, Tensor]:
    """Images and alphas of the splats of `described`, with the given channels."""
    splats = (meta["means2d"], meta["conics"], values, meta["opacities"])
    width, height = meta["width"], meta["height"]
    if values.dtype == torch.float64:
        lists = (width, height, meta["tile_size"], meta["isect_offsets"], meta["flatten_ids"])
        return rasterize_to_pixels(*splats, *lists, backgrounds, packed=rows.packed, absgrad=absgrad)
    behind = None if backgrounds is None else backgrounds.reshape(rows.images, backgrounds.shape[-1])
    gpu = gpu_compositor()
    if gpu is None:
        drawn = (meta["means2d"], meta["conics"], meta["opacities"], meta["depths"])
        tiles = TileBinner.apply(*drawn, rows.first_rows, width, height)
        images, alphas = TileRasterizer.apply(*splats, behind, tiles, absgrad)
    else:
        from pocketgs.torch.gpu_rasterize import GpuRasterizer

        placed = (meta["depths"].detach(), behind, rows.first_rows, (width, height))
        images, alphas = GpuRasterizer.apply(*splats, *placed, absgrad, gpu)
    lead = (*rows.lead, rows.cameras)
    return images.reshape(*lead, *images.shape[1:]), alphas.reshape(*lead, *alphas.shape[1:])
