"""A step through PyTorch against a step of the CPU engine, on the same scene, in turn.

    python bench/torch_step.py                       # 50,000 Gaussians at 504 x 378
    python bench/torch_step.py --gsplat              # and the PyTorch reference in gsplat's own package

It is the same image from the same Gaussians: forward is from parameters to image, activations included; backward is
from the image's gradient to the parameters' gradients. gsplat's reference takes from CUDA which splats count at which
pixels; that is found here, and not timed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import tyro

from cpu_step import random_scene
from pairs import list_pairs
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.lens import kernel_lens
from pocketgs.splat.settings import StepSettings
from pocketgs.torch import rasterization
from pocketgs.training.recipes import recipe_named


def main(
    count: int = 50_000,
    width: int = 504,
    height: int = 378,
    steps: int = 30,
    packed: bool = False,
    gsplat: bool = False,
) -> None:
    """Print the fastest step of each in milliseconds, as other programs only make steps slower, and their ratios.

    Args:
        count: Gaussians.
        width: Of the image.
        height: Of the image.
        steps: Timed of each.
        packed: As rasterization takes it.
        gsplat: Whether to time gsplat's PyTorch reference too, twice.
    """
    gaussians, frames = random_scene(count, width, height)
    engine = CpuEngine()
    engine.set_views(frames)
    engine.upload(gaussians)
    native = native_passes(engine, frames[0].camera)
    through = torch_passes(gaussians, frames[0].camera, packed)
    times = {name: np.zeros((steps, 2)) for name in ("native", "PyTorch")}
    for step in range(-3, steps):
        for name, passes in (("native", native), ("PyTorch", through)):
            forward, backward = timed(passes)
            if step >= 0:
                times[name][step] = forward, backward
    fastest = {name: np.min(values, axis=0) for name, values in times.items()}
    for name, (forward, backward) in fastest.items():
        print(f"{name:8} forward {forward:6.2f} ms, backward {backward:6.2f} ms")
    ratio = fastest["PyTorch"] / fastest["native"]
    print(f"PyTorch / native: forward {ratio[0]:.2f}, backward {ratio[1]:.2f}")
    if gsplat:
        reference = gsplat_passes(gaussians, engine, frames[0].camera)
        forward, backward = np.min([timed(reference) for _ in range(2)], axis=0)
        print(f"gsplat's PyTorch reference: forward {forward:.0f} ms, backward {backward:.0f} ms")
        ratio = np.array([forward, backward]) / fastest["PyTorch"]
        both = (forward + backward) / fastest["PyTorch"].sum()
        print(f"gsplat / ours: forward {ratio[0]:.0f}, backward {ratio[1]:.0f}, together {both:.0f}")
        tiles = intersection_seconds(gaussians, frames[0].camera)
        whole = (1e3 * tiles + forward + backward) / fastest["PyTorch"].sum()
        print(f"its tile intersections take {tiles:.1f} s more: with them {whole:.0f}")


def timed(passes: Callable[[], Callable[[], None]]) -> tuple[float, float]:
    """Milliseconds of a forward pass, and of the backward pass that it gives."""
    started = time.perf_counter()
    backward = passes()
    middle = time.perf_counter()
    backward()
    return 1e3 * (middle - started), 1e3 * (time.perf_counter() - middle)


def native_passes(engine: CpuEngine, camera: Camera) -> Callable[[], Callable[[], None]]:
    """The engine's own passes."""
    view, lens, black = View.of(camera), kernel_lens(camera), np.zeros(3, np.float32)

    settings = StepSettings(recipe_named("pocketgs").rates)

    def forward() -> Callable[[], None]:
        engine._clusters.have_moved(engine._clusters.all)  # as they have after every step
        raster = engine._forward(view, lens, black)
        raster.canvas.d_image[:] = 1e-3
        return lambda: engine._backward(engine._photographs.views[0], raster, settings)

    return forward


def torch_passes(gaussians: Gaussians, camera: Camera, packed: bool) -> Callable[[], Callable[[], None]]:
    """The same through `rasterization`, from the same parameters."""
    leaves, matrix, intrinsics = tensors(gaussians, camera)
    size = (camera.width, camera.height)
    gradient = torch.full((1, camera.height, camera.width, 3), 1e-3)

    def forward() -> Callable[[], None]:
        means, quats, log_scales, logits, sh = leaves
        for leaf in leaves:
            leaf.grad = None
        image, _, _ = rasterization(
            means, quats, log_scales.exp(), logits.sigmoid(), sh, matrix, intrinsics, *size, sh_degree=0, packed=packed
        )
        return lambda: image.backward(gradient)

    return forward


def tensors(gaussians: Gaussians, camera: Camera) -> tuple[list[torch.Tensor], torch.Tensor, torch.Tensor]:
    """The scene's parameters, and the camera's matrix and intrinsics."""
    names = ("means", "quaternions", "log_scales", "opacity_logits", "sh")
    leaves = [torch.from_numpy(getattr(gaussians, name)).clone().requires_grad_() for name in names]
    matrix = torch.from_numpy(camera.world_to_camera).float()[None]
    return leaves, matrix, torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])[None]


def gsplat_passes(gaussians: Gaussians, engine: CpuEngine, camera: Camera) -> Callable[[], Callable[[], None]]:
    """The same by gsplat's `_torch_impl`, front to back with the pairs that the engine finds."""
    from gsplat.cuda import _torch_impl

    sys.path.append(str(Path(__file__).parents[1] / "tests"))
    from pytorch.gsplat_reference import nerfacc

    size, places = (camera.width, camera.height), list_pairs(engine, camera)
    places = places[np.argsort(places[:, 1], kind="stable")]
    splats, pixels = (torch.from_numpy(column.copy()) for column in places.T)
    leaves, matrix, intrinsics = tensors(gaussians, camera)
    gradient = torch.full((1, camera.height, camera.width, 3), 1e-3)
    print(f"{len(splats):,} splat-pixel pairs")

    def forward() -> Callable[[], None]:
        means, quats, log_scales, logits, sh = leaves
        covars, _ = _torch_impl._quat_scale_to_covar_preci(quats, log_scales.exp(), True, False)
        _, means2d, _, conics, _ = _torch_impl._fully_fused_projection(means, covars, matrix, intrinsics, *size)
        colours = (_torch_impl._spherical_harmonics(0, means, sh) + 0.5).clamp(min=0.0)
        with nerfacc():
            shown = (means2d, conics, logits.sigmoid()[None], colours[None])
            image, _ = _torch_impl.accumulate(*shown, splats, pixels, torch.zeros_like(splats), *size)
        return lambda: image.backward(gradient)

    return forward


def intersection_seconds(gaussians: Gaussians, camera: Camera) -> float:
    """Seconds that gsplat's reference takes to find what ours finds in every forward pass: who meets which tile."""
    from gsplat.cuda import _torch_impl

    leaves, matrix, intrinsics = tensors(gaussians, camera)
    means, quats, log_scales, *_ = (leaf.detach() for leaf in leaves)
    size = (camera.width, camera.height)
    covars, _ = _torch_impl._quat_scale_to_covar_preci(quats, log_scales.exp(), True, False)
    radii, means2d, depths, *_ = _torch_impl._fully_fused_projection(means, covars, matrix, intrinsics, *size)
    started = time.perf_counter()
    _torch_impl._isect_tiles(means2d, radii, depths, 16, -(-size[0] // 16), -(-size[1] // 16))
    return time.perf_counter() - started


if __name__ == "__main__":
    tyro.cli(main)
