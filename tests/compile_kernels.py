"""Compile the kernels that most tests need.

Test processes that start side by side without machine code would each compile the same kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from multiprocessing import Process
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pocketgs.capture import Frame
from pocketgs.capture.synthetic import demo_capture
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.renderer import SortFreeRenderer
from pocketgs.sort_free.scene import sort_free
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.system.compile import folder_of, is_compiled
from pocketgs.system.compiled_variants import is_compiled_for
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.machine import ENGINE_KERNELS, FEATURE_KERNELS, PRIOR_KERNELS, SWEEP_KERNELS
from pocketgs.training.preparation import prepare

LENSES = (Lens("opencv", (0.01, 0.0, 0.0, 0.0)), Lens("fisheye", (0.01, 0.0, 0.0, 0.0)), Lens("orthographic"))


def compile_engine() -> None:
    """Compile the CPU engine."""
    if not is_compiled(ENGINE_KERNELS):
        CpuEngine().prepare()


def compile_lenses() -> None:
    """Compile the CPU engine for each lens."""
    for lens in LENSES:
        if not is_compiled_for(ENGINE_KERNELS, lens.model):
            CpuEngine().set_views([Frame("", a_camera(lens), np.zeros((16, 16, 3), np.uint8))])


def compile_outputs() -> None:
    """Compile what only the rasterizer, scenes without sorting and compressed files need."""
    if is_compiled("sort_free"):
        return
    rasterizer, scene = Rasterizer(), a_scene()
    raster = rasterizer.forward(scene, a_camera(), ("rgb", "contributions"))
    rasterizer.backward(raster, rgb=np.ones_like(raster.rgb))
    renderer = SortFreeRenderer()
    drawn = renderer.forward(sort_free(scene, "visibility", 1.0), a_camera())
    renderer.backward(drawn, rgb=np.ones_like(drawn.rgb))
    with TemporaryDirectory() as folder:
        scene.save(Path(folder) / "scene.pgs")


def compile_prior() -> None:
    """Compile the prior, and the synthetic captures' ray casting; poses are a phone's, so that they are refined."""
    if not all(map(is_compiled, (*PRIOR_KERNELS, FEATURE_KERNELS, SWEEP_KERNELS))):
        prepare(demo_capture(width=160, height=120, frames=20), TrainingOptions(effort="quick", engine="cpu"))


def compile_operators() -> None:
    """Compile what `pocketgs.torch` needs, if PyTorch is there, for each of its camera models."""
    if find_spec("torch") is None or any(folder_of("splat.cpu.operators").rglob("*.nbc")):
        return
    import torch

    from pocketgs.torch import rasterization

    scene, camera = a_scene(), a_camera()
    columns = (scene.means, scene.quaternions, np.exp(scene.log_scales), np.full(len(scene), 0.5), scene.sh)
    tensors = [torch.tensor(column, dtype=torch.float32, requires_grad=True) for column in columns]
    poses = torch.tensor(camera.world_to_camera, dtype=torch.float32)[None].requires_grad_()
    intrinsics = torch.tensor([[[16.0, 0.0, 8.0], [0.0, 16.0, 8.0], [0.0, 0.0, 1.0]]])
    for model in ("pinhole", "ortho", "fisheye"):
        image, *_ = rasterization(*tensors, poses, intrinsics, 16, 16, sh_degree=0, camera_model=model)
        image.sum().backward()


def a_camera(lens: Lens | None = None) -> Camera:
    """A small camera at the origin."""
    return Camera(16, 16, 16.0, 16.0, 8.0, 8.0, np.eye(4), lens or Lens())


def a_scene() -> Gaussians:
    """Some Gaussians before that camera."""
    means = np.random.default_rng(0).uniform((-1.0, -1.0, 3.0), (1.0, 1.0, 5.0), (64, 3))
    quaternions = np.tile((1.0, 0.0, 0.0, 0.0), (64, 1))
    return Gaussians(means, np.full((64, 3), -2.0), quaternions, np.zeros(64), np.zeros((64, 1, 3)))


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
