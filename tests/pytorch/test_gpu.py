"""`rasterization` on a GPU, against the CPU."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import torch

from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import Adapter
from pocketgs.torch import rasterization, set_engine

SIZE = {"width": 50, "height": 37}


@pytest.fixture
def on_gpu(adapter: Adapter) -> Iterator[Callable[[], None]]:
    """A function after which images are drawn on the best device."""
    yield lambda: set_engine("webgpu", adapter.name)
    set_engine("cpu")


def results(scene: dict[str, Any], **options: Any) -> dict[str, torch.Tensor]:
    """Images, alphas and all gradients of a loss of both."""
    leaves = {name: tensor.detach().clone().requires_grad_(name != "Ks") for name, tensor in scene.items()}
    image, alpha, meta = rasterization(**leaves, **SIZE, absgrad=True, **options)
    meta["means2d"].retain_grad()
    weights = torch.linspace(0.5, 1.5, image.numel()).reshape(image.shape)
    ((image * weights).square().sum() + 0.3 * (alpha * weights[..., :1]).sum()).backward()
    found = {"image": image.detach(), "alpha": alpha.detach()}
    found |= {f"d_{name}": leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    return found | {"d_means2d": meta["means2d"].grad, "absgrad": meta["means2d"].absgrad, "radii": meta["radii"]}


@pytest.mark.parametrize(
    "options",
    [
        {"sh_degree": 1, "packed": False},
        {"channels": 5, "cameras": 2, "render_mode": "RGB+ED", "rasterize_mode": "antialiased"},
        {"cameras": 2, "camera_model": "fisheye", "packed": True, "opaque": True},
    ],
)
def test_images_and_gradients_are_those_of_the_cpu(
    make_scene: Callable[..., Any], on_gpu: Callable[[], None], options: dict[str, Any]
) -> None:
    made = {name: options.pop(name) for name in ("channels", "cameras", "sh_degree") if name in options}
    scene = make_scene(300, **made)
    if options.pop("opaque", False):
        # Pixels that gsplat's limits are about: α at its most, and splats that would saturate them.
        scene["opacities"] = torch.ones(300)
    if "sh_degree" in made:
        options["sh_degree"] = made["sh_degree"]
    scene["backgrounds"] = torch.rand(made.get("cameras", 1), made.get("channels", 3))
    expected = results(scene, **options)
    on_gpu()
    found = results(scene, **options)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        if name in ("image", "alpha"):
            torch.testing.assert_close(found[name], value, atol=1e-4, rtol=0.0, msg=name)
        else:
            scale = float(value.abs().max())
            torch.testing.assert_close(found[name], value, atol=1e-3 * scale, rtol=1e-3, msg=name)


def test_an_image_that_is_not_the_last_one_can_be_gone_back_from(
    make_scene: Callable[..., Any], on_gpu: Callable[[], None]
) -> None:
    scene = make_scene(50)
    on_gpu()
    first = rasterization(**scene, **SIZE)[0]
    second = rasterization(**{**scene, "colors": scene["colors"] * 0.5}, **SIZE)[0]
    expected = torch.autograd.grad(first.sum(), scene["colors"], retain_graph=True)[0]
    (second.sum() + first.sum()).backward()
    torch.testing.assert_close(scene["colors"].grad, 1.5 * expected)


def test_threads_get_their_own_images(make_scene: Callable[..., Any], on_gpu: Callable[[], None]) -> None:
    scenes = [{name: tensor.detach() for name, tensor in make_scene(50, seed=seed).items()} for seed in (0, 1)]

    def drawn(scene: dict[str, Any]) -> torch.Tensor:
        image: torch.Tensor = rasterization(**scene, **SIZE)[0]
        return image

    on_gpu()
    expected = [drawn(scene) for scene in scenes]
    with ThreadPoolExecutor(2) as executor:
        found = list(executor.map(drawn, 20 * scenes))
    assert all(torch.equal(image, expected[place % 2]) for place, image in enumerate(found))


def test_an_image_of_nothing_is_its_background(make_scene: Callable[..., Any], on_gpu: Callable[[], None]) -> None:
    scene = make_scene(5)
    with torch.no_grad():
        scene["means"] -= torch.tensor([0.0, 0.0, 50.0])
    on_gpu()
    image, alpha, _ = rasterization(**scene, **SIZE, packed=True, backgrounds=torch.tensor([[0.1, 0.2, 0.3]]))
    assert not alpha.any()
    torch.testing.assert_close(image[0, 3, 4], torch.tensor([0.1, 0.2, 0.3]))
    image.sum().backward()


def test_engines_and_gpus_that_do_not_exist() -> None:
    with pytest.raises(PocketGSError, match="cpu or webgpu"):
        set_engine("cuda")  # type: ignore[arg-type]
    with pytest.raises(PocketGSError, match="no such thing"):
        set_engine("webgpu", "no such thing")
