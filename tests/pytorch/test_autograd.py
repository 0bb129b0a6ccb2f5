"""What the autograd graph holds and refuses, and what does not reach gradients."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.autograd.graph import saved_tensors_hooks
from torch.utils.checkpoint import checkpoint

from pocketgs.errors import PocketGSError
from pocketgs.torch import (
    ClusterCompactor,
    fused_ssim,
    quat_scale_to_covar_preci,
    rasterization,
    spherical_harmonics,
    tiles,
)

SIZE = {"width": 50, "height": 37}


def rendered(scene: dict[str, Tensor]) -> Tensor:
    return rasterization(**scene, **SIZE)[0]


def rendered_in_double_precision(scene: dict[str, Tensor]) -> Tensor:
    return rendered({name: tensor.double() for name, tensor in scene.items()})


def compared(scene: dict[str, Tensor]) -> Tensor:
    image = scene["means"].expand(1, 3, 20, 3).repeat(1, 1, 1, 6)
    return fused_ssim(image, torch.zeros_like(image))


def compacted(scene: dict[str, Tensor]) -> Tensor:
    return ClusterCompactor.apply(torch.tensor([0]), scene["means"])[0]


def coloured(scene: dict[str, Tensor]) -> Tensor:
    return spherical_harmonics(1, scene["means"], torch.ones(20, 4, 3))


@pytest.mark.parametrize("function", [rendered, rendered_in_double_precision, compared, compacted, coloured])
def test_second_derivatives_are_refused(make_scene: Callable[..., Any], function: Callable[..., Tensor]) -> None:
    scene = make_scene(20)
    value = function(scene).sum()
    with pytest.raises(PocketGSError, match="create_graph=True is not supported"):
        torch.autograd.grad(value, scene["means"], create_graph=True)


@pytest.mark.parametrize("double", [False, True])
def test_a_loss_holds_no_memory_after_backward(make_scene: Callable[..., Any], double: bool) -> None:
    """Scripts that keep losses, to print them later, would run out of memory."""
    scene = make_scene(20, double=double, sh_degree=1)

    def loss() -> Tensor:
        image, _, _ = rasterization(**scene, width=128, height=96, sh_degree=1)
        error = image.mean()
        if not double:
            error = error + fused_ssim(image.movedim(-1, 1), torch.zeros(1, 3, 96, 128))
        error.backward()
        for tensor in scene.values():
            tensor.grad = None
        return error

    loss()
    tracemalloc.start()
    kept = loss()
    gc.collect()
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept.requires_grad
    assert held < 40_000  # an image's transmittance alone takes more


@pytest.mark.parametrize("double", [False, True])
def test_checkpoints_draw_again_to_save_memory(make_scene: Callable[..., Any], double: bool) -> None:
    scene = make_scene(20, double=double, cameras=2)
    (expected,) = torch.autograd.grad(rendered(scene).sum(), scene["means"])
    (found,) = torch.autograd.grad(checkpoint(rendered, scene, use_reentrant=False).sum(), scene["means"])
    assert torch.equal(found, expected)


@pytest.mark.parametrize(
    "change", [lambda image: image.mul_(0.5), lambda image: image.numpy().fill(0.5), lambda image: image.data.zero_()]
)
def test_changes_of_an_image_do_not_reach_gradients(
    make_scene: Callable[..., Any], change: Callable[[Tensor], Any]
) -> None:
    scene = make_scene(20)
    image = rendered(scene)
    loss = (image * 2.0).sum()
    (expected,) = torch.autograd.grad(loss, scene["means"], retain_graph=True)
    change(image.detach())
    (found,) = torch.autograd.grad(loss, scene["means"])
    assert torch.equal(found, expected)


def test_hooks_may_replace_what_is_saved(make_scene: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """As where large tensors are written to disk. A second image is drawn before backward, in the same memory."""
    monkeypatch.setattr(tiles, "_waiting", [])
    scene = make_scene(200)
    (expected,) = torch.autograd.grad(rendered(scene).sum(), scene["means"])
    with saved_tensors_hooks(lambda saved: saved.clone() if saved.numel() > 500 else saved, lambda saved: saved):
        image = rendered(scene)
        rendered(make_scene(200, seed=1))
    (found,) = torch.autograd.grad(image.sum(), scene["means"])
    assert torch.equal(found, expected)


@pytest.mark.parametrize("mode", ["classic", "antialiased"])
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("name", ["means", "quats", "scales"])
def test_a_gaussian_that_is_no_number_leaves_gradients_alone(
    make_scene: Callable[..., Any], double: bool, name: str, mode: str
) -> None:
    scene = make_scene(20, double=double)
    with torch.no_grad():
        scene[name][3] = torch.nan
    given = scene
    if not double:
        covars, _ = quat_scale_to_covar_preci(scene["quats"].detach(), scene["scales"].detach())
        given = {**scene, "quats": None, "scales": None, "covars": covars}
    image, _, meta = rasterization(**given, **SIZE, packed=False, rasterize_mode=mode)
    image.sum().backward()
    assert not meta["radii"][0, 3].any()
    for each in ("means", "opacities", "colors", "viewmats", name):
        gradient = scene[each].grad
        assert gradient is None or gradient.isfinite().all(), each
