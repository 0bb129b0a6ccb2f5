"""Compile the kernels that most tests need.

Test processes that start side by side without machine code would each compile the same kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from multiprocessing import Process
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pocketgs.capture.synthetic import demo_capture
from pocketgs.geometry.lens import COEFFICIENT_COUNTS, Lens
from pocketgs.sort_free.renderer import SortFreeRenderer
from pocketgs.sort_free.scene import sort_free
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.system.compile import is_compiled
from pocketgs.system.compiled_variants import is_compiled_for
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.machine import ENGINE_KERNELS, FEATURE_KERNELS, PRIOR_KERNELS, SWEEP_KERNELS
from pocketgs.training.preparation import prepare
from splat.training_step import camera_in_front, of_every_size, photograph

CAMERA, SCENE = camera_in_front(16, 16, 16.0), of_every_size(seed=0)


def compile_engine() -> None:
    """Compile the CPU engine."""
    if not is_compiled(ENGINE_KERNELS):
        CpuEngine().prepare()


def compile_lenses() -> None:
    """Compile the CPU engine for each lens."""
    for model, counts in COEFFICIENT_COUNTS.items():
        if not is_compiled_for(ENGINE_KERNELS, model):
            lens = Lens(model, (0.01,) * max(counts))
            CpuEngine().set_views([photograph(replace(CAMERA, lens=lens))])


def compile_outputs() -> None:
    """Compile what only the rasterizer, scenes without sorting and compressed files need."""
    rasterizer = Rasterizer()
    raster = rasterizer.forward(SCENE, CAMERA, ("rgb", "contributions"))
    rasterizer.backward(raster, rgb=np.ones_like(raster.rgb))
    renderer = SortFreeRenderer()
    drawn = renderer.forward(sort_free(SCENE, "visibility", unit=1.0), CAMERA)
    renderer.backward(drawn, rgb=np.ones_like(drawn.rgb))
    with TemporaryDirectory() as folder:
        SCENE.save(Path(folder) / "scene.pgs")


def compile_prior() -> None:
    """Compile the prior, and the synthetic captures' ray casting; poses are a phone's, so that they are refined."""
    if not all(map(is_compiled, (*PRIOR_KERNELS, FEATURE_KERNELS, SWEEP_KERNELS))):
        prepare(demo_capture(width=160, height=120, frames=20), TrainingOptions(effort="quick", engine="cpu"))


def compile_operators() -> None:
    """Compile what `pocketgs.torch` needs, if PyTorch is there, for each of its camera models."""
    if find_spec("torch") is None or is_compiled("splat.cpu.operators"):
        return
    import torch

    from pocketgs.torch import rasterization

    opacities = np.full(len(SCENE), 0.5)
    columns = (SCENE.means, SCENE.quaternions, np.exp(SCENE.log_scales), opacities, SCENE.sh)
    tensors = [torch.tensor(column, dtype=torch.float32, requires_grad=True) for column in columns]
    poses = torch.tensor(CAMERA.world_to_camera, dtype=torch.float32)[None].requires_grad_()
    intrinsics = torch.tensor(CAMERA.intrinsic_matrix, dtype=torch.float32)[None]
    for model in ("pinhole", "ortho", "fisheye"):
        image, *_ = rasterization(*tensors, poses, intrinsics, 16, 16, sh_degree=0, camera_model=model)
        image.sum().backward()


def compile_in_turn(*steps: Callable[[], None]) -> None:
    """Call one after the other."""
    for step in steps:
        step()


def main() -> None:
    """Compile in two processes, which take about as long as each other."""
    plans = ((compile_engine, compile_lenses, compile_outputs), (compile_prior, compile_operators))
    processes = [Process(target=compile_in_turn, args=plan) for plan in plans]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
