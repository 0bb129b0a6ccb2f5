"""nerfstudio's Splatfacto model, unchanged, on PocketGS's rasterization.

    pip install --no-deps nerfstudio==1.1.5    # and what its model file asks for when it is imported
    python bench/splatfacto.py path/to/fern --images images_8

Only what reaches for CUDA or the network is replaced: `Tensor.cuda` gives the tensor, and LPIPS is left out.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Annotated, Any

os.environ["TORCHDYNAMO_DISABLE"] = "1"

import numpy as np
import torch
import tyro

from pocketgs.capture.capture import Frame
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.torch import install_as_gsplat

RATES = {
    "means": 1.6e-4,
    "features_dc": 2.5e-3,
    "features_rest": 1.25e-4,
    "opacities": 0.05,
    "scales": 5e-3,
    "quats": 1e-3,
}
"""Of nerfstudio's method `splatfacto`."""


def main(
    capture: Annotated[Path, tyro.conf.Positional],
    steps: int = 200,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Train, and print the loss.

    Args:
        capture: With a point cloud of its own.
        steps: To take.
        reading: How to read the capture.
    """
    torch.manual_seed(0)
    install_as_gsplat()
    opened = read_capture(capture, reading)
    if opened.points is None:
        raise SystemExit(f"{capture}: has no cloud of its own, expected one with points to start from")
    torch.Tensor.cuda = lambda self, *arguments, **named: self
    import torchmetrics.image.lpip

    torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity = lambda **options: torch.nn.Identity()
    from nerfstudio.data.scene_box import SceneBox
    from nerfstudio.models.splatfacto import SplatfactoModel, SplatfactoModelConfig

    seeds = (torch.from_numpy(opened.points.positions).float(), torch.from_numpy(opened.points.colours * 255.0).float())
    config = SplatfactoModelConfig(num_downscales=0, warmup_length=50, refine_every=50)
    box = SceneBox(torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]))
    model: Any = SplatfactoModel(config, scene_box=box, num_train_data=len(opened.train), seed_points=seeds)
    model.train()
    optimizers = {
        name: torch.optim.Adam([{"params": list(params), "lr": RATES[name]}], eps=1e-15)
        for name, params in model.get_gaussian_param_groups().items()
    }
    model.optimizers = optimizers
    order, losses = np.random.default_rng(0), []
    for step in range(steps):
        started = time.perf_counter()
        frame = opened.train[order.integers(len(opened.train))]
        model.step_cb(Wrapped(optimizers), step)
        outputs = model.get_outputs(camera_of(frame))
        loss = sum(model.get_loss_dict(outputs, {"image": torch.from_numpy(frame.image)}).values())
        loss.backward()
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad()
        model.step_post_backward(step)
        losses.append(float(loss))
        if step % 20 == 19:
            milliseconds = 1e3 * (time.perf_counter() - started)
            loss_now, count = np.mean(losses[-20:]), model.num_points
            print(f"step {step + 1}: loss {loss_now:.4f}, {count:,} Gaussians, {milliseconds:.0f} ms", flush=True)


class Wrapped:
    """As much of nerfstudio's Optimizers as the model asks for."""

    def __init__(self, optimizers: dict[str, torch.optim.Optimizer]) -> None:
        self.optimizers = optimizers


def camera_of(frame: Frame) -> Any:
    """In nerfstudio's axes, y up and z backwards."""
    from nerfstudio.cameras.cameras import Cameras

    camera = frame.camera
    pose = torch.from_numpy(camera.camera_to_world[:3] * np.array([1, -1, -1, 1])).float()[None]
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    return Cameras(pose, *(torch.tensor([[float(each)]]) for each in numbers), camera.width, camera.height)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
