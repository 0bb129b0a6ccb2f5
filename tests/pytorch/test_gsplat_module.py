"""Scripts that import gsplat run on our functions, including gsplat's own strategies."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import Adapter
from pocketgs.torch import install_as_gsplat
from pocketgs.torch.gsplat_module import VERSION

PREPARE = """
import torch
import pocketgs.torch
pocketgs.torch.install_as_gsplat({version!r}, cuda_means_cpu={cuda_means_cpu})
"""

TRAIN = """
import gsplat
from gsplat.rendering import rasterization
from gsplat.strategy import DefaultStrategy, MCMCStrategy
assert gsplat.rasterization is rasterization and rasterization.__module__.startswith("pocketgs")
torch.manual_seed(0)
count, viewmats = 400, torch.eye(4)[None]
Ks = torch.tensor([[[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]])
params = torch.nn.ParameterDict({
    "means": torch.rand(count, 3) * 2 - 1 + torch.tensor([0, 0, 3.0]),
    "quats": torch.randn(count, 4),
    "scales": torch.full((count, 3), -3.0),
    "opacities": torch.full((count,), -1.0),
    "sh0": torch.rand(count, 1, 3),
})
optimizers = {name: torch.optim.Adam([{"params": each, "lr": 0.02}]) for name, each in params.items()}
image = (torch.linspace(0, 1, 64) > 0.5).float()[None, None, :, None].expand(1, 48, 64, 3)
losses = []
for step in range(45):
    shown, _, info = rasterization(
        params["means"], params["quats"], params["scales"].exp(), params["opacities"].sigmoid(), params["sh0"],
        viewmats, Ks, 64, 48, sh_degree=0, packed=PACKED, absgrad=ABSGRAD,
    )
    strategy_arguments = (params, optimizers, state, step, info)
    strategy.step_pre_backward(*strategy_arguments)
    loss = (shown - image).abs().mean()
    loss.backward()
    losses.append(loss.item())
    for optimizer in optimizers.values():
        optimizer.step()
        optimizer.zero_grad()
    strategy.step_post_backward(*strategy_arguments, **more)
assert losses[-1] < 0.6 * losses[0], losses
print(len(params["means"]))
"""

DEFAULT = """
from gsplat.strategy import DefaultStrategy
PACKED, ABSGRAD = {packed}, {absgrad}
strategy = DefaultStrategy(refine_start_iter=5, refine_every=10, absgrad=ABSGRAD, refine_scale2d_stop_iter=40)
state, more = strategy.initialize_state(), {{"packed": PACKED}}
"""

MCMC = """
from gsplat import MCMCStrategy
PACKED, ABSGRAD = False, False
strategy = MCMCStrategy(cap_max=450, refine_start_iter=5, refine_every=10)
state, more = strategy.initialize_state(), {"lr": 1e-5}
"""


def run(
    script: str, version: str | None = None, cuda_means_cpu: bool = False, warning: str = "resolves to PocketGS"
) -> str:
    prepare = PREPARE.format(version=version, cuda_means_cpu=cuda_means_cpu)
    command = [sys.executable, "-c", prepare + textwrap.dedent(script)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert warning in done.stderr
    return done.stdout


def test_default_strategy_multiplies_gaussians_and_mcmc_grows_to_its_bound() -> None:
    """One after the other in one process, since importing PyTorch takes longer than training."""
    strategies = (DEFAULT.format(packed=False, absgrad=False), DEFAULT.format(packed=True, absgrad=True), MCMC)
    plain, packed, mcmc = map(int, run("".join(strategy + TRAIN for strategy in strategies)).split())
    assert plain > 400
    assert packed > 400
    assert mcmc == 450


def test_default_strategy_multiplies_gaussians_on_a_gpu(adapter: Adapter) -> None:
    engine = f"pocketgs.torch.set_engine('webgpu', {adapter.name!r})\n"
    assert int(run(engine + DEFAULT.format(packed=True, absgrad=True) + TRAIN)) > 400


def test_earlier_versions_have_one_radius() -> None:
    script = """
    from gsplat import rasterization
    shape = (torch.rand(1, 4), torch.tensor([[0.1, 0.2, 0.3]]))
    gaussians = (torch.tensor([[0.0, 0, 2]]), *shape, torch.ones(1), torch.rand(1, 3))
    camera = (torch.eye(4)[None], torch.tensor([[[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]]), 64, 48)
    print(tuple(rasterization(*gaussians, *camera, packed=False)[2]["radii"].shape))
    """
    warning = "1.4.0 was asked for: meta['radii'] changed in 1.5, so strategies of the installed package fail"
    assert run(script, "1.4.0", warning=warning).strip() == "(1, 1)"
    assert run(script, "1.5.3").strip() == "(1, 1, 2)"


def test_modules_are_looked_up_and_what_is_missing_says_so() -> None:
    """After installing twice: what needs CUDA when it is called, and, without gsplat's package, what it has."""
    script = """
    import importlib.util
    pocketgs.torch.install_as_gsplat()
    import gsplat.cuda, fused_ssim
    for name in ("gsplat", "gsplat.cuda", "gsplat.rendering", "fused_ssim"):
        assert importlib.util.find_spec(name).name == name
    from gsplat.rendering import depth_to_normal, get_projection_matrix
    for name in ("compression", "exporter", "strategy", "utils", "version"):
        assert getattr(gsplat, name).__name__ == f"gsplat.{name}"
    assert gsplat.utils.depth_to_normal is depth_to_normal and gsplat.cuda._torch_impl._persp_proj
    assert not hasattr(gsplat.rendering, "strategy")

    from gsplat import rasterization_2dgs, rasterization_inria_wrapper
    from gsplat.cuda._wrapper import RollingShutterType, fully_fused_projection, rasterize_to_pixels_2dgs
    from gsplat.cuda._wrapper import FThetaCameraDistortionParameters, FThetaPolynomialType, adam, persp_proj
    from gsplat.cuda._wrapper import UnscentedTransformParameters, _make_lazy_cuda_func
    from gsplat.distributed import cli
    from gsplat.optimizers import SelectiveAdam
    from gsplat.relocation import compute_relocation
    from gsplat.rendering import _rasterization
    from pocketgs import PocketGSError
    assert SelectiveAdam.__module__.startswith("pocketgs") and gsplat.__version__
    try:
        rasterization_2dgs()
    except PocketGSError as error:
        assert "rasterization_2dgs is not supported" in str(error)
    else:
        raise AssertionError
    assert not hasattr(gsplat, "anything_else")

    find_spec = importlib.util.find_spec
    importlib.util.find_spec = lambda name: None if name == "gsplat" else find_spec(name)
    pocketgs.torch.install_as_gsplat()
    """
    run(script, warning=f"is not installed: pip install gsplat=={VERSION} if the script uses them")


def test_versions_that_are_none_are_refused() -> None:
    for version in ("v1.5.3", "1", "latest"):
        with pytest.raises(PocketGSError, match=f"version: found '{version}', expected one such as 1.5.3"):
            install_as_gsplat(version)


def test_scripts_that_name_cuda_run_on_the_cpu() -> None:
    script = """
    import io
    from fused_ssim import fused_ssim
    from gsplat.distributed import cli

    def main(local_rank, world_rank, world_size, arguments):
        device = f"cuda:{local_rank}"
        layers = torch.nn.ParameterDict({"one": torch.nn.Parameter(torch.ones(2))}).to(device).cuda()
        made = [torch.rand(1, device=device), torch.zeros(2, device=torch.device("cuda")), torch.ones(1).cuda()]
        made += [torch.ones(1).to(local_rank), torch.ones(1).pin_memory(), torch.zeros(2, device=local_rank)]
        assert all(tensor.device.type == "cpu" for tensor in (*made, layers["one"], made[0].to("cuda:0")))
        for place in (device, torch.device(device), local_rank):
            torch.cuda.set_device(place)
        torch.cuda.reset_peak_memory_stats()
        saved = io.BytesIO()
        torch.save(made, saved)
        saved.seek(0)
        assert torch.load(saved, map_location=device, weights_only=True)[0].device.type == "cpu"
        torch.cuda.synchronize()
        assert not torch.cuda.is_available() and (world_rank, world_size, arguments) == (0, 1, "given")

    assert cli(main, "given")
    """
    run(script, cuda_means_cpu=True)
    failed = subprocess.run(
        [sys.executable, "-c", PREPARE.format(version=None, cuda_means_cpu=False) + "torch.ones(1).to('cuda')"],
        capture_output=True,
    )
    assert failed.returncode != 0
