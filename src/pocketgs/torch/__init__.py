"""gsplat's contract on PocketGS's kernels: PyTorch functions that need no CUDA.

    from pocketgs.torch import rasterization

The extra `torch` brings PyTorch: `pip install pocketgs[torch]`. See docs/gsplat.md.
"""

from pocketgs.torch.covariance import proj, quat_scale_to_covar_preci, world_to_cam
from pocketgs.torch.harmonics import spherical_harmonics
from pocketgs.torch.intersections import isect_offset_encode, isect_tiles
from pocketgs.torch.pixels import rasterize_to_pixels
from pocketgs.torch.project import Project2D
from pocketgs.torch.projection import fully_fused_projection
from pocketgs.torch.rasterize import TileRasterizer
from pocketgs.torch.rendering import rasterization
from pocketgs.torch.tiles import TileBinner

__all__ = [
    "Project2D",
    "TileBinner",
    "TileRasterizer",
    "fully_fused_projection",
    "isect_offset_encode",
    "isect_tiles",
    "proj",
    "quat_scale_to_covar_preci",
    "rasterization",
    "rasterize_to_pixels",
    "spherical_harmonics",
    "world_to_cam",
]
