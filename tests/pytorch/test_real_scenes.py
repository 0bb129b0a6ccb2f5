"""Images and gradients agree with gsplat's reference on scenes trained from real captures too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

import pocketgs
from pocketgs.gpu.adapters import Adapter
from pocketgs.torch import rasterization, set_engine
from pytorch import gsplat_reference

SIDE = 6
"""Factor by which images are reduced: the reference evaluates every Gaussian at every pixel."""

TRAINED = ("means", "quats", "scales", "opacities", "colors", "viewmats")


def tensors_of(scene: pocketgs.Gaussians, camera: pocketgs.Camera, dtype: torch.dtype) -> dict[str, Any]:
    arrays = {
        "means": torch.from_numpy(scene.means),
        "quats": torch.from_numpy(scene.quaternions),
        "scales": torch.from_numpy(scene.log_scales).exp(),
        "opacities": torch.from_numpy(scene.opacity_logits).sigmoid(),
        "colors": torch.from_numpy(scene.sh),
        "viewmats": torch.from_numpy(camera.world_to_camera)[None],
    }
    intrinsics = [[camera.fx / SIDE, 0, camera.cx / SIDE], [0, camera.fy / SIDE, camera.cy / SIDE], [0, 0, 1]]
    tensors = {name: tensor.to(dtype).requires_grad_() for name, tensor in arrays.items()}
    return {**tensors, "Ks": torch.tensor([intrinsics], dtype=dtype)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reading", "training"),
    [
        ("fern", {"images": "images_8"}, {"iterations": 60, "max_keyframes": 6, "bundle": False}),
        ("lego", {"downscale": 4}, {"iterations": 150, "prior": "none"}),
    ],
)
def test_a_trained_scene(
    data_folder: Path, adapter: Adapter, name: str, reading: dict[str, Any], training: dict[str, Any]
) -> None:
    capture = pocketgs.open_capture(data_folder / name, **reading)
    capture = replace(capture, train=capture.train[:: max(len(capture.train) // 16, 1)])
    scene = pocketgs.train(capture, engine="cpu", max_gaussians=6000, evaluate_every=0, **training).scene
    camera = capture.held_out[0].camera
    size = {"width": camera.width // SIDE, "height": camera.height // SIDE}
    degree = int(scene.sh.shape[1] ** 0.5) - 1
    ours, theirs = (tensors_of(scene, camera, dtype) for dtype in (torch.float32, torch.float64))
    image, alpha, _ = rasterization(**ours, **size, sh_degree=degree)
    expected, expected_alpha, _ = gsplat_reference.rasterization(**theirs, **size, sh_degree=degree)
    assert alpha.mean() > 0.2
    for found, right in ((image, expected), (alpha, expected_alpha)):
        difference = (found - right).abs().flatten()
        # In float32 a contribution of just 1/255 may fall on the other side of it.
        assert difference.quantile(0.999) < 1e-4
        assert difference.max() < 1 / 255
    image.square().sum().backward()
    expected.square().sum().backward()
    for each in TRAINED:
        gradient, right = ours[each].grad, theirs[each].grad
        assert (gradient - right).norm() < 1e-3 * right.norm(), each
    compare_with_gpu(ours, {**size, "sh_degree": degree}, image, adapter)


def compare_with_gpu(scene: dict[str, Any], options: dict[str, Any], image: torch.Tensor, adapter: Adapter) -> None:
    on_cpu = {each: scene[each].grad.clone() for each in TRAINED}
    for each in TRAINED:
        scene[each].grad = None
    set_engine("webgpu", adapter.name)
    try:
        found, _, _ = rasterization(**scene, **options)
        found.square().sum().backward()
    finally:
        set_engine("cpu")
    difference = (found - image).abs().flatten()
    assert difference.quantile(0.999) < 1e-4
    assert difference.max() < 1 / 255
    for each in TRAINED:
        assert (scene[each].grad - on_cpu[each]).norm() < 1e-3 * on_cpu[each].norm(), each
