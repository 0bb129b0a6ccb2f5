"""gsplat's strategies, from its own package, on PocketGS's rasterization, against PocketGS's own of the same kind.

    python bench/gsplat_strategies.py path/to/fern --images images_8 --strategy mcmc

Both runs start from the same Gaussians, with the same loss, rates and schedule; the one through PyTorch has torch's
Adam.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
import tyro
from torch import Tensor

from pocketgs import photometric_loss
from pocketgs.capture.capture import Frame
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.metrics.evaluation import psnr
from pocketgs.prior.prior import PreparedCapture
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.seeding.seeds import SEEDINGS
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.rendering import render_frame
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.torch import install_as_gsplat
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.effort import sized
from pocketgs.training.preparation import prepare
from pocketgs.training.recipes import Recipe, camera_extent, recipe_named
from pocketgs.training.strategies.adc import DensityControl
from pocketgs.training.strategies.mcmc import Relocation
from pocketgs.training.train import train

UNBOUNDED = 10_000_000

install_as_gsplat()

from gsplat import DefaultStrategy, MCMCStrategy, rasterization  # noqa: E402 - what this script is about


def main(
    capture: Annotated[Path, tyro.conf.Positional],
    strategy: Literal["adc", "mcmc"] = "adc",
    iterations: int = 2000,
    gaussians: int = 100_000,
    own: bool = True,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Train twice and print what came of it.

    Args:
        capture: What to train on.
        strategy: DefaultStrategy against `adc`, or MCMCStrategy against `mcmc`.
        iterations: Of each run.
        gaussians: At most at the start and, with mcmc, later.
        own: Whether to run PocketGS's own too.
        reading: How to read the capture.
    """
    torch.manual_seed(0)
    opened = read_capture(capture, reading)
    sizes = [(frame.camera.width, frame.camera.height) for frame in opened.train]
    asked = TrainingOptions(iterations=iterations, max_gaussians=gaussians, strategy=strategy, engine="cpu")
    prepared = prepare(opened, sized(asked, sizes), Stopwatch())
    if own:
        # DefaultStrategy knows no bound.
        most = gaussians if strategy == "mcmc" else UNBOUNDED
        result = train(prepared, asked, evaluate_every=0, max_gaussians=most)
        engine = create_engine(asked.engine_options)
        engine.upload(result.scene)
        values = [
            psnr(render_frame(engine, frame, prepared.background), frame.image / 255.0, frame.mask)
            for frame in prepared.held_out
        ]
        seconds = result.seconds["training"] / iterations
        print(
            f"PocketGS {strategy}: {np.mean(values):.2f} dB, {len(result.scene):,}, {1e3 * seconds:.0f} ms a step",
            flush=True,
        )
    Trainer(prepared, recipe_named("pocketgs"), strategy, iterations, gaussians).run()


class Trainer:
    """A trainer as gsplat's examples have it."""

    def __init__(self, capture: PreparedCapture, recipe: Recipe, strategy: str, iterations: int, most: int) -> None:
        assert capture.points is not None
        self.capture, self.recipe, self.iterations = capture, recipe, iterations
        cameras = [frame.camera for frame in capture.train]
        self.extent = camera_extent(cameras, capture.points)
        self.rates = recipe.rates_for(iterations, recipe.length(cameras, capture.points))
        seeds = SEEDINGS["discs"](capture.points, recipe.opacity, recipe.sh_degree, recipe.seed_size)
        self.params = parameters_of(seeds.select(morton_order(seeds.means)))
        first = self.rates_by_name(0)
        self.optimizers = {
            name: torch.optim.Adam(
                [{"params": self.params[name], "lr": rate}],
                eps=recipe.adam.epsilon,
                betas=(0.9, recipe.adam.beta2),
                fused=True,
            )
            for name, rate in first.items()
        }
        self.is_mcmc = strategy == "mcmc"
        if self.is_mcmc:
            times = Relocation.scaled(iterations)
            start, stop = int(iterations * times.start), int(iterations * times.stop)
            self.strategy: Any = MCMCStrategy(
                cap_max=most, refine_start_iter=start, refine_stop_iter=stop, refine_every=times.every
            )
            self.state = self.strategy.initialize_state()
        else:
            control = DensityControl.scaled(iterations)
            self.strategy = DefaultStrategy(
                refine_start_iter=control.start, refine_stop_iter=control.stop, refine_every=control.every
            )
            self.state = self.strategy.initialize_state(scene_scale=self.extent)
        self.strategy.check_sanity(self.params, self.optimizers)

    def rates_by_name(self, step: int) -> dict[str, float]:
        """The rates of this step, by gsplat's names. A quaternion's is half of that in its tangent space."""
        rates = self.recipe.schedule(self.rates, step / self.iterations)
        return {
            "means": rates.means,
            "scales": rates.log_scales,
            "quats": 0.5 * rates.rotations,
            "opacities": rates.opacity_logits,
            "sh0": rates.sh_dc,
            "shN": rates.sh_rest,
        }

    def run(self) -> None:
        """Train, and say how many Gaussians there are and how well they show the held-out views."""
        times = []
        for step in range(self.iterations):
            started = time.perf_counter()
            loss = self.step(step)
            times.append(time.perf_counter() - started)
            if step % max(self.iterations // 10, 1) == 0 or step == self.iterations - 1:
                count, milliseconds = len(self.params["means"]), 1e3 * float(np.median(times[-100:]))
                print(f"step {step}: loss {loss:.4f}, {count:,} Gaussians, {milliseconds:.0f} ms a step", flush=True)
        with torch.no_grad():
            shown = [self.render(frame)[0][0].clamp(0, 1).numpy() for frame in self.capture.held_out]
        pairs = zip(shown, self.capture.held_out, strict=True)
        values = [psnr(image, frame.image / 255.0, frame.mask) for image, frame in pairs]
        name, count = type(self.strategy).__name__, len(self.params["means"])
        print(f"gsplat {name}: {np.mean(values):.2f} dB, {count:,}, {1e3 * np.mean(times):.0f} ms a step")

    def step(self, step: int) -> float:
        """One view."""
        order = np.random.default_rng((0, step // len(self.capture.train))).permutation(len(self.capture.train))
        frame = self.capture.train[order[step % len(order)]]
        rates = self.rates_by_name(step)
        for name, optimizer in self.optimizers.items():
            optimizer.param_groups[0]["lr"] = rates[name]
        image, _, info = self.render(frame)
        if not self.is_mcmc:
            self.strategy.step_pre_backward(self.params, self.optimizers, self.state, step, info)
        loss = Photometric.apply(image[0], frame.image)
        if self.is_mcmc:
            price = (
                0.01 * self.params["opacities"].sigmoid().mean()
                + 0.01 / self.extent * self.params["scales"].exp().mean()
            )
            (loss + price).backward()
        else:
            loss.backward()
        for optimizer in self.optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        state = (self.params, self.optimizers, self.state, step, info)
        if self.is_mcmc:
            # 80 at the start in a scene of extent 1, as in the paper, whatever the rate of the means is.
            slowness = rates["means"] / self.rates_by_name(0)["means"]
            self.strategy.step_post_backward(*state, lr=80.0 * slowness / self.extent / self.strategy.noise_lr)
        else:
            self.strategy.step_post_backward(*state, packed=False)
        return float(loss.detach())

    def render(self, frame: Frame) -> Any:
        """As gsplat's simple_trainer does."""
        params, camera = self.params, frame.camera
        matrix = torch.from_numpy(camera.world_to_camera).float()[None]
        intrinsics = torch.tensor([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])[None]
        return rasterization(
            params["means"],
            params["quats"],
            params["scales"].exp(),
            params["opacities"].sigmoid(),
            torch.cat([params["sh0"], params["shN"]], 1),
            matrix,
            intrinsics,
            camera.width,
            camera.height,
            sh_degree=self.recipe.sh_degree,
            packed=False,
            backgrounds=torch.tensor([self.capture.background], dtype=torch.float32),
        )


class Photometric(torch.autograd.Function):
    """PocketGS's own loss: 0.8 L1 + 0.2 (1 - SSIM)."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, photograph: np.ndarray) -> Tensor:
        """The loss of (H, W, 3) against uint8."""
        loss, gradient = photometric_loss(image.detach().numpy(), photograph)
        ctx.gradient = torch.from_numpy(gradient)
        return image.new_tensor(loss)

    @staticmethod
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Its gradient."""
        return ctx.gradient * d_outputs[0], None


def parameters_of(scene: Gaussians) -> torch.nn.ParameterDict:
    """Parameters by gsplat's names."""
    sh = torch.from_numpy(scene.sh)
    tensors = {
        "means": torch.from_numpy(scene.means),
        "scales": torch.from_numpy(scene.log_scales),
        "quats": torch.from_numpy(scene.quaternions),
        "opacities": torch.from_numpy(scene.opacity_logits),
        "sh0": sh[:, :1],
        "shN": sh[:, 1:],
    }
    return torch.nn.ParameterDict(
        {name: torch.nn.Parameter(each.contiguous().clone()) for name, each in tensors.items()}
    )


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
