"""Memory layout of views, splats, tiles and parameters: names of columns and sizes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.constants import ALPHA_MIN
from pocketgs.splat.parameters import first_column
from pocketgs.system.compile import part

TILE_WIDTH = 8
TILE_HEIGHT = 16
TILE_PIXELS = TILE_WIDTH * TILE_HEIGHT

# One projected splat: a row of float32. The exponent of its falloff is to base 2, and includes the opacity:
# log2 α(dx, dy) = LOG2_OPACITY + EXPONENT_XX dx² + EXPONENT_XY dx dy + EXPONENT_YY dy².
# The channels to composite follow: red, green and blue first, if colours are composited.
MEAN_X, MEAN_Y, EXPONENT_XX, EXPONENT_XY, EXPONENT_YY, LOG2_OPACITY, DEPTH, RED, GREEN, BLUE = range(10)
FIRST_CHANNEL, COLOURS = RED, 3
SPLAT_FIELDS = FIRST_CHANNEL + COLOURS

# A tile intersection: a row of int32. ROWS stores the first and one past the last of the tile's rows that the splat
# reaches, as first << 8 | end.
INTERSECTION_SPLAT, INTERSECTION_SLOT, INTERSECTION_ROWS = range(3)
INTERSECTION_FIELDS = 3

# Slots of a Gaussian's intersections: a row of int32, the first slot and their number.
SLOTS_FIRST, SLOTS_COUNT = range(2)

# One row of gradients, and of each of Adam's moments, per Gaussian.
GRADIENT_MEAN = first_column("means")
GRADIENT_LOG_SCALE = first_column("log_scales")
GRADIENT_ROTATION = first_column("quaternions")
GRADIENT_OPACITY = first_column("opacity_logits")
GRADIENT_SH = first_column("sh")

LOG2_ALPHA_MIN = np.float32(math.log2(ALPHA_MIN))


CLUSTER = 256
"""Number of Gaussians in a cluster, the unit of culling and of updates."""


class SceneArrays(NamedTuple):
    """The parameters of N Gaussians for kernels, not copied: some kernels write to them.

    Write only in a function that the `prange` loop calls: Numba drops writes to a tuple's arrays in the loop's own body
    (https://github.com/numba/numba/issues/7135). `len(scene)` is 5, the number of arrays; N is `len(scene.means)`.

    Attributes:
        means: (N, 3) float32.
        log_scales: (N, 3) float32.
        quaternions: (N, 4) float32 of unit length.
        opacity_logits: (N,) float32.
        sh: (N, K, 3) float32. K is 0 if the splats' channels are not colours.
    """

    means: np.ndarray
    log_scales: np.ndarray
    quaternions: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray

    @staticmethod
    def of(scene: Gaussians) -> SceneArrays:
        """The arrays of a scene whose quaternions have unit length."""
        # Kernels would be compiled anew for arrays that are read-only.
        return SceneArrays(*(np.require(getattr(scene, name), requirements="W") for name in PARAMETERS))


class View(NamedTuple):
    """A camera for kernels: `rotation` and `translation` of world_to_camera, `centre` in the world.

    Its lens is passed separately: see `pocketgs.splat.cpu.lenses.lens`.
    """

    rotation: np.ndarray
    translation: np.ndarray
    centre: np.ndarray
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    antialiased: bool

    @staticmethod
    def of(camera: Camera, antialiased: bool = False) -> View:
        """The view of a camera."""
        return View(
            np.ascontiguousarray(camera.world_to_camera[:3, :3]),
            np.ascontiguousarray(camera.world_to_camera[:3, 3]),
            np.ascontiguousarray(camera.centre),
            float(camera.fx),
            float(camera.fy),
            float(camera.cx),
            float(camera.cy),
            int(camera.width),
            int(camera.height),
            antialiased,
        )

    @property
    def tiles(self) -> int:
        """Number of tiles; they are numbered down the columns."""
        return -(-self.width // TILE_WIDTH) * tiles_down(self.height)


@part
def tiles_down(height: int) -> int:
    """Number of tiles in a column of an image of `height` pixels."""
    return -(-height // TILE_HEIGHT)
