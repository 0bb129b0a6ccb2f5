"""A step through PyTorch against a step of the CPU engine, on the same scene, in turn.

    python bench/torch_step.py                       # 50,000 Gaussians at 504 x 378
    python bench/torch_step.py --gsplat              # and gsplat's PyTorch reference, on a scene that it can hold

It is the same image from the same Gaussians: forward is from parameters to image, activations included; backward is
from the image's gradient to the parameters' gradients.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch
import tyro

from cpu_step import random_scene
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import View
from pocketgs.torch import rasterization


def main(count: int = 50_000, width: int = 504, height: int = 378, steps: int = 30, packed: bool = False) -> None:
    """Print medians in milliseconds, and their ratios.

    Args:
        count: Gaussians.
        width: Of the image.
        height: Of the image.
        steps: Timed of each.
        packed: As rasterization takes it.
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
    medians = {name: np.median(values, axis=0) for name, values in times.items()}
    for name, (forward, backward) in medians.items():
        print(f"{name:8} forward {forward:6.2f} ms, backward {backward:6.2f} ms")
    ratio = medians["PyTorch"] / medians["native"]
    print(f"PyTorch / native: forward {ratio[0]:.2f}, backward {ratio[1]:.2f}")


def timed(passes: Callable[[], Callable[[], None]]) -> tuple[float, float]:
    """Milliseconds of a forward pass, and of the backward pass that it gives."""
    started = time.perf_counter()
    backward = passes()
    middle = time.perf_counter()
    backward()
    return 1e3 * (middle - started), 1e3 * (time.perf_counter() - middle)


def native_passes(engine: CpuEngine, camera: Camera) -> Callable[[], Callable[[], None]]:
    """The engine's own passes."""
    view, black = View.of(camera), np.zeros(3, np.float32)

    def forward() -> Callable[[], None]:
        engine._clusters.have_moved(engine._clusters.all)  # as they have after every step
        raster = engine._forward(view, black)
        raster.canvas.d_image[:] = 1e-3
        return lambda: engine._backward(view, raster, False)

    return forward


def torch_passes(gaussians: Gaussians, camera: Camera, packed: bool) -> Callable[[], Callable[[], None]]:
    """The same through `rasterization`, from the same parameters."""
    names = ("means", "quaternions", "log_scales", "opacity_logits", "sh")
    leaves = [torch.from_numpy(getattr(gaussians, name)).clone().requires_grad_() for name in names]
    matrix = torch.from_numpy(camera.world_to_camera).float()[None]
    intrinsics = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])[None]
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


if __name__ == "__main__":
    tyro.cli(main)
