"""Scenes as tensors. Without PyTorch or gsplat's wheel, `test_installed.py` reports it, and the others are skipped."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import pytest

NEEDED = ("torch", "gsplat")
missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
collect_ignore_glob = ["test_[!i]*.py", "test_in[!s]*.py"] if missing else []


@pytest.fixture
def make_scene() -> Callable[..., dict[str, Any]]:
    """A function that scatters Gaussians in front of two cameras, as arguments of `rasterization`."""
    import torch

    def make(
        count: int = 60,
        *,
        sh_degree: int | None = None,
        channels: int = 3,
        cameras: int = 1,
        seed: int = 0,
        double: bool = False,
    ) -> dict[str, Any]:
        generator = torch.Generator().manual_seed(seed)

        def numbers(*shape: int, low: float = 0.0, high: float = 1.0) -> Any:
            return low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)

        means = numbers(count, 3, low=-1.0)
        # Depths that stay in order under the small steps of finite differences.
        means[:, 2] = torch.linspace(2.5, 5.5, count, dtype=torch.float64)[torch.randperm(count, generator=generator)]
        colours = (count, channels) if sh_degree is None else (count, (sh_degree + 1) ** 2, 3)
        matrices = torch.eye(4, dtype=torch.float64).repeat(cameras, 1, 1)
        for camera in range(cameras):
            angle = torch.tensor(0.1 * camera, dtype=torch.float64)
            matrices[camera, 0, 0] = matrices[camera, 2, 2] = angle.cos()
            matrices[camera, 0, 2], matrices[camera, 2, 0] = angle.sin(), -angle.sin()
            matrices[camera, :3, 3] = torch.tensor([0.05, -0.1 * camera, 0.1])
        intrinsics = torch.tensor([[44.0, 0.0, 25.3], [0.0, 46.0, 17.8], [0.0, 0.0, 1.0]], dtype=torch.float64)
        scene = {
            "means": means,
            "quats": numbers(count, 4, low=-1.0) + 0.1,
            "scales": numbers(count, 3, low=0.03, high=0.25),
            "opacities": numbers(count, low=0.1, high=0.95),
            "colors": numbers(*colours, low=0.0 if sh_degree is None else -0.4, high=1.0),
            "viewmats": matrices,
            "Ks": intrinsics.repeat(cameras, 1, 1),
        }
        dtype = torch.float64 if double else torch.float32
        return {name: tensor.to(dtype).requires_grad_(name != "Ks") for name, tensor in scene.items()}

    return make
