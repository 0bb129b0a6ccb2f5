"""Building blocks: separate passes, the optimiser, culling of clusters, and relocation."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import torch

from pocketgs.errors import PocketGSError
from pocketgs.splat.cpu.bin import Binner
from pocketgs.torch import (
    ClusterCompactor,
    ClusterCuller,
    Project2D,
    Projection,
    SelectiveAdam,
    TileBinner,
    TileRasterizer,
    compute_relocation,
    proj,
    quat_scale_to_covar_preci,
    rasterization,
    tiles,
    world_to_cam,
)

SIZE = (50, 37)


def test_the_blocks_in_a_row_are_rasterization(make_scene: Callable[..., Any]) -> None:
    """Culling clusters first does not change the result."""
    scene = make_scene(2000)
    with torch.no_grad():
        scene["means"][:1000] -= torch.tensor([0.0, 0.0, 50.0])  # behind the camera
    expected, _, _ = rasterization(**scene, width=SIZE[0], height=SIZE[1])
    expected.square().sum().backward()
    names = ("means", "quats", "scales", "opacities", "colors")
    found = {name: scene[name].detach().clone().requires_grad_() for name in names}
    camera = (scene["viewmats"].detach(), scene["Ks"])
    clusters = ClusterCuller.apply(found["means"], found["scales"], camera[0][0], camera[1][0], *SIZE, 0.01)
    assert clusters.tolist() == [3, 4, 5, 6, 7]
    means, quats, scales, opacities, colors = ClusterCompactor.apply(clusters, *found.values())
    assert len(means) == 2000 - 768
    centres, depths, conics, _, _, _ = Project2D.apply(means, quats, scales, opacities, *camera, Projection(*SIZE))
    tiles = TileBinner.apply(centres, conics, opacities, depths, [0, len(means)], *SIZE)
    image, _ = TileRasterizer.apply(centres, conics, colors, opacities, None, tiles, False)
    assert torch.equal(image, expected)
    image.square().sum().backward()
    for name in names:
        torch.testing.assert_close(found[name].grad, scene[name].grad)


def test_selective_adam_moves_only_what_was_seen() -> None:
    values = torch.rand(1000, 2, 3, requires_grad=True)
    before, seen = values.detach().clone(), torch.rand(1000) < 0.3
    optimiser = SelectiveAdam([{"params": [values], "lr": 0.1}], eps=1e-8, betas=(0.9, 0.999))
    mean = square = torch.zeros(1000, 2, 3)
    expected = before.clone()
    for step in range(3):
        gradient = torch.rand(1000, 2, 3) - 0.5 * step
        values.grad = gradient.clone()
        optimiser.step(seen)
        mean, square = 0.9 * mean + 0.1 * gradient, 0.999 * square + 0.001 * gradient**2
        expected[seen] -= 0.1 * (mean / (square.sqrt() + 1e-8))[seen]
    assert torch.equal(values[~seen], before[~seen])
    torch.testing.assert_close(values.detach(), expected, rtol=1e-4, atol=1e-5)
    with pytest.raises(PocketGSError, match="with 999 rows"):
        optimiser.step(seen[:999])


def test_selective_adam_takes_settings_that_are_tensors() -> None:
    plain, tensors = (torch.nn.Parameter(torch.ones(50, 3)) for _ in range(2))
    optimisers = [SelectiveAdam([{"params": [values], "lr": 0.1}]) for values in (plain, tensors)]
    group = optimisers[1].param_groups[0]
    group |= {name: torch.tensor(group[name], dtype=torch.float64) for name in ("lr", "eps")}
    group["betas"] = tuple(torch.tensor(group["betas"], dtype=torch.float64))
    for values, optimiser in zip((plain, tensors), optimisers, strict=True):
        values.grad = torch.linspace(-1, 1, 150).reshape(50, 3)
        optimiser.step(torch.ones(50, dtype=torch.bool))
    assert torch.equal(plain, tensors)
    assert not torch.equal(plain, torch.ones(50, 3))


def test_selective_adam_refuses_sparse_gradients() -> None:
    values = torch.nn.Parameter(torch.ones(50, 3))
    values.grad = torch.ones(50, 3).to_sparse(1)
    with pytest.raises(PocketGSError, match="found a sparse gradient, expected a dense one: sparse_grad=False"):
        SelectiveAdam([values]).step(torch.ones(50, dtype=torch.bool))


@pytest.mark.parametrize("shape", [(50, 0, 3), (0, 3)])
def test_selective_adam_takes_empty_tensors(shape: tuple[int, ...]) -> None:
    """Such as the higher coefficients of harmonics of degree 0."""
    values = torch.nn.Parameter(torch.zeros(shape))
    values.grad = torch.zeros(shape)
    optimiser = SelectiveAdam([values], eps=1e-8, betas=(0.9, 0.999))
    optimiser.step(torch.ones(shape[0], dtype=torch.bool))
    assert optimiser.state[values]["exp_avg"].shape == shape


def test_selective_adam_updates_columns_of_a_larger_tensor() -> None:
    whole = torch.rand(50, 16, 3)
    sliced, apart = (torch.nn.Parameter(values) for values in (whole[:, :1], whole[:, :1].clone()))
    assert not sliced.is_contiguous()
    for values in (sliced, apart):
        optimiser = SelectiveAdam([values], eps=1e-8, betas=(0.9, 0.999))
        for _ in range(2):
            values.grad = torch.linspace(-1, 1, 150).reshape(50, 1, 3)
            optimiser.step(torch.arange(50) % 2 == 0)
    assert torch.equal(sliced, apart)


def test_selective_adam_keeps_moments_that_are_not_contiguous() -> None:
    mirrored, plain = torch.rand(3, 50).T.requires_grad_(), torch.rand(50, 3, requires_grad=True)
    optimisers = [SelectiveAdam([values], eps=1e-8, betas=(0.9, 0.999)) for values in (mirrored, plain)]
    moments = {name: torch.zeros_like(mirrored) for name in ("exp_avg", "exp_avg_sq")}
    assert not moments["exp_avg"].is_contiguous()
    optimisers[0].state[mirrored] = {"step": torch.tensor(0.0), **moments}
    for step in range(2):
        for values, optimiser in zip((mirrored, plain), optimisers, strict=True):
            values.grad = torch.linspace(-1, 1 + step, 150).reshape(50, 3)
            optimiser.step(torch.arange(50) % 2 == 0)
    for name in moments:
        kept, expected = (
            optimiser.state[each][name] for each, optimiser in zip((mirrored, plain), optimisers, strict=True)
        )
        assert expected.any()
        assert torch.equal(kept, expected)


class SlowPool(list[tuple[int, Binner]]):
    """Waits before each deletion, while a garbage collection gives a binner back."""

    def __delitem__(self, place: Any) -> None:
        tiles._give_back(2, Binner(2))
        time.sleep(0.1)
        super().__delitem__(place)


def test_threads_take_different_binners(monkeypatch: pytest.MonkeyPatch) -> None:
    pool = SlowPool((1, Binner(1)) for _ in range(2))
    monkeypatch.setattr(tiles, "_waiting", pool)
    with ThreadPoolExecutor(2) as executor:
        one, other = executor.map(tiles._take_binner, [1, 1])
    assert one is not other
    assert [threads for threads, _ in pool] == [2, 2]


def test_relocation_follows_the_papers_equation() -> None:
    most = 51
    binoms = torch.tensor([[float(math.comb(n, k)) for k in range(most)] for n in range(most)])
    opacities, scales = torch.tensor([0.9, 0.3, 0.05]), torch.rand(3, 3)
    ratios = torch.tensor([2, 7, 80])
    each, sizes = compute_relocation(opacities, scales, ratios, binoms)
    assert ratios.tolist() == [2, 7, 51]
    for row, n in enumerate((2, 7, 51)):
        o = 1.0 - (1.0 - opacities[row].item()) ** (1.0 / n)
        total = sum(
            math.comb(i - 1, k) * (-1.0) ** k / math.sqrt(k + 1) * o ** (k + 1)
            for i in range(1, n + 1)
            for k in range(i)
        )
        assert each[row].item() == pytest.approx(o, rel=1e-6)
        torch.testing.assert_close(sizes[row], scales[row] * (opacities[row].item() / total), rtol=1e-5, atol=0.0)


def test_covariances_are_exact_under_autocast(make_scene: Callable[..., Any]) -> None:
    scene = make_scene()
    gaussians = (scene["means"], scene["quats"], scene["scales"])
    images = []
    for enabled in (False, True):
        with torch.autocast("cpu", torch.bfloat16, enabled=enabled):
            covars, inverses = quat_scale_to_covar_preci(*gaussians[1:])
            assert covars is not None
            assert inverses is not None
            local = world_to_cam(gaussians[0], covars, scene["viewmats"])
            found = (covars, inverses, *local, *proj(*local, scene["Ks"], *SIZE))
            assert all(tensor.dtype == torch.float32 for tensor in found)
            given = {**scene, "quats": None, "scales": None, "covars": covars}
            images.append(rasterization(**given, width=SIZE[0], height=SIZE[1])[0])
    assert torch.equal(*images)


def test_gradients_of_backgrounds_are_exact_under_autocast(make_scene: Callable[..., Any]) -> None:
    scene, gradients = make_scene(), []
    for enabled in (False, True):
        backgrounds = torch.rand(1, 3, generator=torch.Generator().manual_seed(0)).requires_grad_()
        with torch.autocast("cpu", torch.bfloat16, enabled=enabled):
            image, _, _ = rasterization(**scene, width=SIZE[0], height=SIZE[1], backgrounds=backgrounds)
            gradients += torch.autograd.grad(image.square().sum(), backgrounds)
    assert torch.equal(*gradients)
