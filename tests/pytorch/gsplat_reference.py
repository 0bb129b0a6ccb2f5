"""The PyTorch reference of gsplat's wheel, with its CUDA parts replaced by plain PyTorch."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import torch
from gsplat.cuda import _torch_impl
from torch import Tensor

ALPHA_MIN, ALPHA_MAX, TRANSMITTANCE_MIN = 1.0 / 255.0, 0.999, 1e-4


@contextmanager
def nerfacc() -> Iterator[None]:
    """Replaces nerfacc, which gsplat's `accumulate` imports and which needs CUDA."""
    module = ModuleType("nerfacc")
    vars(module)["render_weight_from_alpha"] = _weights
    vars(module)["accumulate_along_rays"] = _accumulate
    sys.modules["nerfacc"] = module
    yield
    del sys.modules["nerfacc"]


def _weights(alphas: Tensor, ray_indices: Tensor, n_rays: int) -> tuple[Tensor, Tensor]:
    """α T of samples sorted by ray and by depth, from sums of logarithms."""
    logs = torch.log1p(-alphas.double())
    sums = logs.cumsum(0) - logs
    first = torch.ones_like(ray_indices, dtype=torch.bool)
    first[1:] = ray_indices[1:] != ray_indices[:-1]
    light = (sums - sums[first][first.cumsum(0) - 1]).exp()
    return (alphas * light).to(alphas.dtype), light


def _accumulate(weights: Tensor, values: Tensor | None, ray_indices: Tensor, n_rays: int) -> Tensor:
    products = weights[:, None] if values is None else weights[:, None] * values
    return products.new_zeros(n_rays, products.shape[1]).index_add(0, ray_indices, products)


@torch.no_grad()
def pairs(
    means2d: Tensor, conics: Tensor, opacities: Tensor, depths: Tensor, radii: Tensor, size: tuple[int, int]
) -> Any:
    """Pairs of contributing splats and pixels of one image, front to back, by the rule of gsplat's CUDA kernels."""
    width, height = size
    x, y = torch.arange(width) + 0.5, torch.arange(height) + 0.5
    order = torch.argsort(depths, stable=True)
    order = order[radii[order, 0] > 0]
    light, full = torch.ones(height, width, dtype=means2d.dtype), torch.zeros(height, width, dtype=torch.bool)
    splats, pixels = [], []
    for index in order:
        dx, dy = x[None, :] - means2d[index, 0], y[:, None] - means2d[index, 1]
        a, b, c = conics[index]
        alpha = (opacities[index] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)).clamp(max=ALPHA_MAX)
        counts = (alpha >= ALPHA_MIN) & ~full
        fills = counts & (light * (1.0 - alpha) <= TRANSMITTANCE_MIN)
        full |= fills
        counts &= ~fills
        light = torch.where(counts, light * (1.0 - alpha), light)
        found = torch.nonzero(counts.flatten())[:, 0]
        pixels.append(found)
        splats.append(torch.full_like(found, int(index)))
    order = torch.argsort(torch.cat(pixels), stable=True)
    return torch.cat(splats)[order], torch.cat(pixels)[order]


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
    sh_degree: int | None = None,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
    rasterize_mode: str = "classic",
    camera_model: str = "pinhole",
    eps2d: float = 0.3,
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Call the parts of the wheel's reference in the order of its `rasterization`, for (N, ...) Gaussians."""
    covars, _ = _torch_impl._quat_scale_to_covar_preci(quats, scales, True, False)
    compensated = rasterize_mode == "antialiased"
    radii, means2d, depths, conics, factors = _torch_impl._fully_fused_projection(
        means, covars, viewmats, Ks, width, height, eps2d, calc_compensations=compensated, camera_model=camera_model
    )
    shown = opacities.expand(len(viewmats), -1)
    if factors is not None:
        shown = shown * factors
    values = colors.expand(len(viewmats), *colors.shape[-(2 if sh_degree is None else 3) :])
    if sh_degree is not None:
        directions = means - torch.inverse(viewmats)[:, None, :3, 3]
        values = (_torch_impl._spherical_harmonics(sh_degree, directions, values) + 0.5).clamp(min=0.0)
    if render_mode in ("D", "ED"):
        values, backgrounds = depths[..., None], None
    elif render_mode != "RGB":
        values = torch.cat([values, depths[..., None]], -1)
        backgrounds = None if backgrounds is None else torch.nn.functional.pad(backgrounds, (0, 1))
    images, alphas = [], []
    for camera in range(len(viewmats)):
        own = (means2d[camera], conics[camera], shown[camera])
        splats, pixels = pairs(*own, depths[camera], radii[camera], (width, height))
        with nerfacc():
            zero = torch.zeros_like(splats)
            of_camera = (means2d[camera, None], conics[camera, None], shown[camera, None], values[camera, None])
            image, alpha = _torch_impl.accumulate(*of_camera, splats, pixels, zero, width, height)
        images.append(image[0])
        alphas.append(alpha[0])
    image, alpha = torch.stack(images), torch.stack(alphas)
    if backgrounds is not None:
        image = image + backgrounds[:, None, None, :] * (1.0 - alpha)
    if "ED" in render_mode:
        image = torch.cat([image[..., :-1], image[..., -1:] / alpha.clamp(min=1e-10)], -1)
    meta = {"radii": radii, "means2d": means2d, "depths": depths, "conics": conics, "opacities": shown}
    return image, alpha, meta
