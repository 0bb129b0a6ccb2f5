"""gsplat's `fully_fused_projection`: the fast pass where possible, otherwise plain PyTorch."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.splat.constants import ALPHA_MIN, MIN_DETERMINANT
from pocketgs.splat.cpu.operators.projection import REACH, UNBOUNDED
from pocketgs.torch.arrays import check_on_cpu, check_shape, check_tensors, checked_dtype
from pocketgs.torch.covariance import from_upper_triangle, proj, quat_scale_to_covar_preci, world_to_cam
from pocketgs.torch.project import Project2D, ProjectedSplats, Projection
from pocketgs.torch.rows import Rows
from pocketgs.torch.unsupported import check_camera_model

_LEAST_DETERMINANT = 1e-10
"""What is divided by instead of less, so that gradients of Gaussians that are not drawn are finite."""


def fully_fused_projection(
    means: Tensor,
    covars: Tensor | None,
    quats: Tensor | None,
    scales: Tensor | None,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    eps2d: float = 0.3,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    packed: bool = False,
    sparse_grad: bool = False,
    calc_compensations: bool = False,
    camera_model: str = "pinhole",
    opacities: Tensor | None = None,
) -> tuple[Any, ...]:
    """Project Gaussians into cameras.

    Args:
        means: (..., N, 3).
        covars: (..., N, 6) upper triangles of covariances, instead of quaternions and scales, or None.
        quats: (..., N, 4) w, x, y, z of any length.
        scales: (..., N, 3) standard deviations.
        viewmats: (..., C, 4, 4) world_to_camera.
        Ks: (..., C, 3, 3) intrinsics in pixels.
        width: of the images.
        height: of the images.
        eps2d: added to both variances on the image, in pixels².
        near_plane: minimum depth of visible Gaussians.
        far_plane: maximum depth.
        radius_clip: Gaussians with radii up to this, in pixels, are not visible.
        packed: whether only visible Gaussians have rows.
        sparse_grad: whether gradients of means, quats and scales are sparse; only with `packed`.
        calc_compensations: whether to compute compensations.
        camera_model: "pinhole", "ortho" or "fisheye".
        opacities: (..., N), which give tighter bounds; None for opaque Gaussians.

    Returns:
        Radii (..., C, N, 2) int32, means (..., C, N, 2), depths (..., C, N), conics (..., C, N, 3), compensations
        (..., C, N) or None. With `packed`, indices of batches, cameras and Gaussians (nnz,) int64 come first, and the
        others have nnz rows instead of (..., C, N). Rows of invisible Gaussians are zeros.

    Raises:
        PocketGSError: shapes or types disagree, or an argument is not supported.
    """
    sizes = (eps2d, near_plane, far_plane, radius_clip, calc_compensations, packed, sparse_grad)
    projection = Projection(width, height, *sizes, camera_model)
    check_tensors(1, optional=True, opacities=opacities)
    check_tensors(2, means=means)
    check_tensors(2, optional=True, covars=covars, quats=quats, scales=scales)
    check_tensors(3, viewmats=viewmats, Ks=Ks)
    splats = projected(means, covars, quats, scales, opacities, viewmats, Ks, projection)
    lead, cameras, count = tuple(means.shape[:-2]), viewmats.shape[-3], means.shape[-2]
    centres, depths, conics, factors, radii = in_rows(splats, projection, (*lead, cameras, count))
    ids = Rows(lead, cameras, count, splats.seen, packed).ids or ()
    return *ids, radii, centres, depths, conics, factors


def projected(
    means: Tensor,
    covars: Tensor | None,
    quats: Tensor | None,
    scales: Tensor | None,
    opacities: Tensor | None,
    viewmats: Tensor,
    Ks: Tensor,
    projection: Projection,
) -> ProjectedSplats:
    """`fully_fused_projection`, with its settings in one object, before the rows get their shape."""
    tensors = {"means": means, "covars": covars, "quats": quats, "scales": scales}
    dtype = checked_dtype({**tensors, "viewmats": viewmats, "opacities": opacities})
    check_on_cpu("Ks", Ks)
    check_camera_model(projection.camera_model)
    lead, count, cameras = tuple(means.shape[:-2]), means.shape[-2], viewmats.shape[-3]
    check_shape("means", means, (*lead, count, 3))
    check_shape("viewmats", viewmats, (*lead, cameras, 4, 4))
    check_shape("Ks", Ks, (*lead, cameras, 3, 3))
    if opacities is not None:
        check_shape("opacities", opacities, (*lead, count))
    if projection.sparse_grad and (not projection.packed or lead):
        raise PocketGSError("sparse_grad: it takes packed=True, and means without batches")
    if covars is None and (quats is None or scales is None):
        raise PocketGSError("fully_fused_projection: found neither covars nor both quats and scales")
    bounding = means.new_empty((*lead, 0)) if opacities is None else opacities
    if covars is None and quats is not None and scales is not None:
        check_shape("quats", quats, (*lead, count, 4))
        check_shape("scales", scales, (*lead, count, 3))
        if dtype == torch.float32:
            return ProjectedSplats(*Project2D.apply(means, quats, scales, bounding, viewmats, Ks, projection))
        finite, (means, quats, scales) = _finite_rows(means, quats, scales)
        matrices, _ = quat_scale_to_covar_preci(quats, scales, compute_preci=False)
    else:
        assert covars is not None
        check_shape("covars", covars, (*lead, count, 6))
        finite, (means, covars) = _finite_rows(means, covars)
        matrices = from_upper_triangle(covars)
    assert matrices is not None
    if projection.sparse_grad:
        raise PocketGSError("sparse_grad: it takes float32 quats and scales")
    return _project(means, matrices, finite, bounding, viewmats, Ks.to(dtype), projection)


def _finite_rows(*tensors: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Where all numbers of a Gaussian are finite, (..., N) bool, and the (..., N, X) tensors, elsewhere ones.

    A NaN of a Gaussian that is not drawn would become the gradient of the camera.
    """
    finite = torch.cat(tensors, -1).isfinite().all(-1)
    return finite, [torch.where(finite[..., None], tensor, 1.0) for tensor in tensors]


def _project(
    means: Tensor,
    covars: Tensor,
    finite: Tensor,
    opacities: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    projection: Projection,
) -> ProjectedSplats:
    """`Project2D` in plain PyTorch, for given covariances and for double precision; what is not finite is invisible."""
    size = (projection.width, projection.height)
    local, turned = world_to_cam(means, covars, viewmats)
    depths = local[..., 2]
    in_range = (depths >= projection.near_plane) & (depths <= projection.far_plane) & finite[..., None, :]
    # Invisible Gaussians must not divide by a depth of 0, or their gradients become NaN.
    local = torch.where(in_range[..., None], local, local.new_tensor([0.0, 0.0, 1.0]))
    centres, covariances = proj(local, turned, Ks, *size, projection.camera_model)
    xx, xy, yy = covariances[..., 0, 0], covariances[..., 0, 1], covariances[..., 1, 1]
    before = xx * yy - xy * xy
    xx, yy = xx + projection.eps2d, yy + projection.eps2d
    determinant = (xx * yy - xy * xy).clamp(min=_LEAST_DETERMINANT)
    compensations = _root(before / determinant) if projection.compensated else torch.ones_like(depths)
    conics = torch.stack([yy, -xy, xx], -1) / determinant[..., None]
    with torch.no_grad():
        drawn = torch.full_like(depths, UNBOUNDED)
        if opacities.shape[-1]:
            drawn = opacities[..., None, :] * compensations
        reach = (2.0 * (drawn / ALPHA_MIN).clamp(min=1.0).log()).sqrt().clamp(max=REACH)
        radii = (reach[..., None] * torch.stack([xx, yy], -1).sqrt()).ceil()
        seen = in_range & (drawn >= ALPHA_MIN) & drawn.isfinite() & (radii > projection.radius_clip).any(-1)
        inside = (centres + radii > 0.0) & (centres - radii < centres.new_tensor(size))
        seen &= inside.all(-1) & centres.isfinite().all(-1) & conics.isfinite().all(-1)
        seen &= determinant > MIN_DETERMINANT * xx * yy
        radii = torch.where(seen[..., None], radii, 0.0).int()
    rows = torch.nonzero(seen.flatten())[:, 0]
    flat = [centres.reshape(-1, 2), depths.reshape(-1), conics.reshape(-1, 3), compensations.reshape(-1)]
    if projection.packed:
        arrays = [each.index_select(0, rows) for each in (*flat, radii.reshape(-1, 2))]
        return ProjectedSplats._make([*arrays, rows])
    mask = seen.flatten()
    kept = [torch.where(mask[:, None] if each.ndim == 2 else mask, each, 0.0) for each in flat]
    return ProjectedSplats._make([*kept, radii.reshape(-1, 2), rows])


def _root(squares: Tensor) -> Tensor:
    """√ of what is positive, otherwise 0, with a gradient of 0 there: that of √0 is infinite, and 0 times it is NaN."""
    positive = squares > 0.0
    return torch.where(positive, torch.where(positive, squares, 1.0).sqrt(), 0.0)


def in_rows(
    splats: ProjectedSplats, projection: Projection, shape: tuple[int, ...]
) -> tuple[Tensor, Tensor, Tensor, Tensor | None, Tensor]:
    """Centres, depths, conics, compensations (None if not asked for) and radii.

    They are (..., C, N, X) of the given (..., C, N), or as they are if packed.
    """
    centres, depths, conics, compensations, radii, _ = splats
    factors = compensations if projection.compensated else None
    if projection.packed:
        return centres, depths, conics, factors, radii
    if factors is not None:
        factors = factors.reshape(shape)
    by_image = (centres.reshape(*shape, 2), depths.reshape(shape), conics.reshape(*shape, 3))
    return *by_image, factors, radii.reshape(*shape, 2)
