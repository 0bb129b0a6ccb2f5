"""gsplat's interface on PocketGS's kernels: PyTorch functions that need no CUDA.

    from pocketgs.torch import rasterization

The extra `torch` installs PyTorch.
"""

# Sets how threads wait; PyTorch's own threads follow it if it is loaded later.
import pocketgs.system.compile  # noqa: F401
from pocketgs.extras import how_to_install

try:
    import torch  # noqa: F401 - that it is there
except ModuleNotFoundError as error:
    if error.name != "torch":
        raise
    raise ModuleNotFoundError(f"pocketgs.torch needs PyTorch: {how_to_install('torch')}", name="torch") from error

from pocketgs.torch.clusters import ClusterCompactor, ClusterCuller
from pocketgs.torch.covariance import proj, quat_scale_to_covar_preci, world_to_cam
from pocketgs.torch.engine import set_engine
from pocketgs.torch.gsplat_module import install_as_gsplat
from pocketgs.torch.harmonics import spherical_harmonics
from pocketgs.torch.intersections import isect_offset_encode, isect_tiles
from pocketgs.torch.optimizers import SelectiveAdam
from pocketgs.torch.pixels import rasterize_to_pixels
from pocketgs.torch.project import Project2D, Projection
from pocketgs.torch.projection import fully_fused_projection
from pocketgs.torch.rasterize import TileRasterizer
from pocketgs.torch.relocation import compute_relocation
from pocketgs.torch.rendering import rasterization
from pocketgs.torch.similarity import fused_ssim
from pocketgs.torch.tiles import TileBinner

__all__ = [
    "ClusterCompactor",
    "ClusterCuller",
    "Project2D",
    "Projection",
    "SelectiveAdam",
    "TileBinner",
    "TileRasterizer",
    "compute_relocation",
    "fully_fused_projection",
    "fused_ssim",
    "install_as_gsplat",
    "isect_offset_encode",
    "isect_tiles",
    "proj",
    "quat_scale_to_covar_preci",
    "rasterization",
    "rasterize_to_pixels",
    "set_engine",
    "spherical_harmonics",
    "world_to_cam",
]
