"""Our functions under gsplat's name, so that scripts that import gsplat run without CUDA."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import logging
import pkgutil
import re
import sys
from collections.abc import Callable
from functools import wraps
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

import torch

from pocketgs.errors import PocketGSError
from pocketgs.torch import covariance, harmonics, intersections, pixels, projection, rendering
from pocketgs.torch.devices import let_cuda_mean_cpu
from pocketgs.torch.optimizers import SelectiveAdam
from pocketgs.torch.relocation import compute_relocation
from pocketgs.torch.similarity import fused_ssim
from pocketgs.torch.unsupported import unsupported

LOG = logging.getLogger("pocketgs.torch")

VERSION = "1.5.3"
"""The version of gsplat whose interface this is."""

RADII_HAVE_TWO_SIDES_SINCE = (1, 5)

BLOCKS: dict[str, Callable[..., Any]] = {
    "fully_fused_projection": projection.fully_fused_projection,
    "isect_offset_encode": intersections.isect_offset_encode,
    "isect_tiles": intersections.isect_tiles,
    "proj": covariance.proj,
    "quat_scale_to_covar_preci": covariance.quat_scale_to_covar_preci,
    "rasterize_to_pixels": pixels.rasterize_to_pixels,
    "spherical_harmonics": harmonics.spherical_harmonics,
    "world_to_cam": covariance.world_to_cam,
}

UNSUPPORTED = (
    "FThetaCameraDistortionParameters",
    "FThetaPolynomialType",
    "UnscentedTransformParameters",
    "_make_lazy_cuda_func",
    "_make_lazy_cuda_obj",
    "_rasterization",
    "accumulate",
    "accumulate_2dgs",
    "adam",
    "all_gather_int32",
    "all_gather_tensor_list",
    "all_to_all_int32",
    "all_to_all_tensor_list",
    "fully_fused_projection_2dgs",
    "fully_fused_projection_with_ut",
    "rasterization_2dgs",
    "rasterization_2dgs_inria_wrapper",
    "rasterization_inria_wrapper",
    "rasterize_to_indices_in_range",
    "rasterize_to_indices_in_range_2dgs",
    "rasterize_to_pixels_2dgs",
    "rasterize_to_pixels_eval3d",
)
"""Names that can be imported, so that scripts that may use them start; calling them is an error."""

FROM_GSPLAT_PACKAGE = {
    "gsplat": {
        "DefaultStrategy": "gsplat.strategy:DefaultStrategy",
        "MCMCStrategy": "gsplat.strategy:MCMCStrategy",
        "Strategy": "gsplat.strategy:Strategy",
        "PngCompression": "gsplat.compression:PngCompression",
        "export_splats": "gsplat.exporter:export_splats",
        "compression": "gsplat.compression:",
        "exporter": "gsplat.exporter:",
        "strategy": "gsplat.strategy:",
        "utils": "gsplat.utils:",
        "version": "gsplat.version:",
    },
    "gsplat.cuda": {"_torch_impl": "gsplat.cuda._torch_impl:", "_torch_impl_2dgs": "gsplat.cuda._torch_impl_2dgs:"},
    "gsplat.rendering": {
        "depth_to_normal": "gsplat.utils:depth_to_normal",
        "get_projection_matrix": "gsplat.utils:get_projection_matrix",
    },
}
"""What modules take from gsplat's own package, as "module:object": it is plain PyTorch, and runs on our functions."""


def install_as_gsplat(
    version: str | None = None, *, even_with_cuda: bool = False, cuda_means_cpu: bool = False
) -> ModuleType:
    """Make `import gsplat` return PocketGS's functions, for the rest of this process.

    Strategies, compression and export come from gsplat's own package, if installed (`pip install gsplat` needs no
    CUDA): they are plain PyTorch. If CUDA is available, nothing is replaced. `import fused_ssim`, which gsplat's
    trainers use, returns ours unless that package is installed.

    Args:
        version: version of gsplat that callers expect; None for that of the installed package. Before 1.5,
            `meta["radii"]` has one number per Gaussian, the larger of the two; the installed package's strategies fail
            if they expect the other form.
        even_with_cuda: whether to replace gsplat even if CUDA is available.
        cuda_means_cpu: whether PyTorch's functions take the device "cuda" for the CPU, in the calling thread, so that
            scripts that name it run as they are. `torch.cuda.is_available()` remains false.

    Returns:
        The module returned by `import gsplat`.

    Raises:
        PocketGSError: the version is not one.
    """
    if torch.cuda.is_available() and not even_with_cuda:
        LOG.warning("CUDA is available: gsplat stays as it is")
        return importlib.import_module("gsplat")
    installed = _installed_version()
    version = version or installed or VERSION
    if installed and _two_sides(installed) != _two_sides(version):
        found = f"gsplat {installed} is installed, and {version} was asked for"
        LOG.warning("%s: meta['radii'] changed in 1.5, so strategies of the installed package fail", found)
    for name in [name for name in sys.modules if name == "gsplat" or name.startswith("gsplat.")]:
        del sys.modules[name]
    folders = _installed_folders()
    module = _make_module("gsplat", folders, version)
    LOG.warning("gsplat %s resolves to PocketGS: rasterization runs without CUDA", version)
    if not folders:
        missing = "gsplat's own package, which has strategies, compression and export, is not installed"
        LOG.warning("%s: pip install gsplat==%s if the script uses them; it needs no CUDA", missing, VERSION)
    if importlib.util.find_spec("fused_ssim") is None:
        similarity = _empty_module("fused_ssim")
        vars(similarity)["fused_ssim"] = fused_ssim
        sys.modules["fused_ssim"] = similarity
        LOG.warning("fused_ssim, which is not installed, resolves to PocketGS too")
    if cuda_means_cpu:
        let_cuda_mean_cpu()
        LOG.warning('the device "cuda" means the CPU')
    return module


def run_alone(function: Callable[..., Any], arguments: Any, verbose: bool = False) -> bool:
    """Call a trainer's function as the only process of the only machine: gsplat's `distributed.cli` needs CUDA."""
    function(0, 0, 1, arguments)
    return True


def _make_module(name: str, folders: list[str], version: str) -> ModuleType:
    """Make the module and its submodules that would need CUDA; all others are imported from the given folders."""
    rasterization = rendering.rasterization if _two_sides(version) else _with_one_radius(rendering.rasterization)
    stubs = {each: _stub(each) for each in UNSUPPORTED}
    shutters = {"RollingShutterType": rendering.RollingShutterType}
    parts: dict[str, dict[str, Any]] = {
        "": {**BLOCKS, **stubs, **shutters, "rasterization": rasterization, "SelectiveAdam": SelectiveAdam},
        "rendering": {**BLOCKS, **stubs, **shutters, "rasterization": rasterization},
        "distributed": {**stubs, "cli": run_alone},
        "relocation": {"compute_relocation": compute_relocation},
        "optimizers": {"SelectiveAdam": SelectiveAdam},
        "optimizers.selective_adam": {"SelectiveAdam": SelectiveAdam},
        "cuda": {},
        "cuda._backend": {"_C": None},
        "cuda._wrapper": {**BLOCKS, **stubs, **shutters, "persp_proj": covariance.proj},
    }
    for part, contents in parts.items():
        is_package = part in ("", "cuda", "optimizers")
        places = [f"{folder}/{part}" if part else folder for folder in folders] if is_package else None
        module = _empty_module(f"{name}.{part}" if part else name, places)
        vars(module).update(contents)
        if module.__name__ in FROM_GSPLAT_PACKAGE:
            vars(module)["__getattr__"] = _lookup(module.__name__)
        sys.modules[module.__name__] = module
        parent, _, own = module.__name__.rpartition(".")
        if parent:
            setattr(sys.modules[parent], own, module)
    whole = sys.modules[name]
    vars(whole)["__version__"] = version
    return whole


def _empty_module(name: str, folders: list[str] | None = None) -> ModuleType:
    """A module with the spec that `importlib.util.find_spec` wants of every module; a package if folders are given."""
    module = ModuleType(name, __doc__)
    module.__spec__ = ModuleSpec(name, None, is_package=folders is not None)
    if folders is not None:
        module.__spec__.submodule_search_locations = folders
        module.__path__ = folders
    return module


def _lookup(module: str) -> Callable[[str], Any]:
    """A function that imports a module's names that come from gsplat's own package, on first use."""

    def look_up(name: str) -> Any:
        place = FROM_GSPLAT_PACKAGE[module].get(name)
        if place is None:
            raise AttributeError(f"module {module!r} (PocketGS) has no attribute {name!r}")
        try:
            return pkgutil.resolve_name(place)
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith("gsplat"):
                raise
            missing = f"{module}.{name} comes from gsplat's own package: pip install gsplat=={VERSION}"
            raise ImportError(missing) from error

    return look_up


def _stub(name: str) -> Callable[..., Any]:
    """A function that can be imported but not called."""

    def stub(*arguments: Any, **named: Any) -> Any:
        unsupported(f"gsplat.{name}", "it exists in CUDA only")

    stub.__name__ = name
    return stub


def _with_one_radius(rasterization: Callable[..., Any]) -> Callable[..., Any]:
    """`rasterization` with `meta["radii"]` as before gsplat 1.5."""

    @wraps(rasterization)
    def earlier(*arguments: Any, **named: Any) -> Any:
        image, alpha, meta = rasterization(*arguments, **named)
        meta["radii"] = meta["radii"].amax(-1)
        return image, alpha, meta

    return earlier


def _two_sides(version: str) -> bool:
    """Whether radii have two sides in this version.

    Raises:
        PocketGSError: it is not a version.
    """
    numbers = re.match(r"(\d+)\.(\d+)", version)
    if numbers is None:
        raise PocketGSError(f"version: found {version!r}, expected one such as {VERSION}")
    return tuple(map(int, numbers.groups())) >= RADII_HAVE_TWO_SIDES_SINCE


def _installed_folders() -> list[str]:
    spec = importlib.util.find_spec("gsplat")
    return list(spec.submodule_search_locations or []) if spec else []


def _installed_version() -> str | None:
    try:
        return importlib.metadata.version("gsplat")
    except importlib.metadata.PackageNotFoundError:
        return None
