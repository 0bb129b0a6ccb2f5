"""The differentiable rasterizer for custom code: images of Gaussians, and gradients with respect to them.

    rasterizer = pocketgs.Rasterizer()
    seen = rasterizer.forward(scene, camera, ("rgb", "depth"))
    gradients = rasterizer.backward(seen, rgb=d_rgb)

Each output is converted to channels per Gaussian (`splat/channels.py`), and all channels are composited in one pass.
Engines implement `Backend` of `splat/backend.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.background import BLACK, Background, checked_background
from pocketgs.splat.backend import Backend, Composite, Contributions, Parameters
from pocketgs.splat.channels import Channels, channels_of
from pocketgs.splat.engine import check_threads
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.pose import matrix_gradient, pose_gradient
from pocketgs.splat.quaternions import quaternion_gradient

Output = Literal["rgb", "alpha", "depth", "median_depth", "normals", "features", "radii", "contributions"]
OUTPUTS = get_args(Output)
CompositorName = Literal["over", "sum"]
COMPOSITORS = get_args(CompositorName)
HIDING = ("depth", "median_depth", "contributions")
"""Outputs that depend on occlusion, which only the compositor "over" supports."""


@dataclass(frozen=True)
class Raster:
    """A rendered view. Outputs that were not requested are None.

    Attributes:
        rgb: (H, W, 3) colour over the background.
        alpha: (H, W) coverage in [0, 1].
        depth: (H, W) expected depth, Σ α_i T_i z_i / alpha with z of `Camera.depths`; 0 where alpha is 0.
        median_depth: (H, W) depth of the Gaussian that brings the transmittance below one half; 0 where none does. It
            has no gradient.
        normals: (H, W, 3) Σ α_i T_i n_i in the world's axes, with n_i the unit vector along a Gaussian's shortest axis,
            towards the camera.
        features: (H, W, D) Σ α_i T_i f_i.
        radii: (N, 2) half the width and height, in pixels, of the region with α of at least 1/255; 0 if not drawn.
        contributions: of each Gaussian.
    """

    rgb: np.ndarray | None
    alpha: np.ndarray | None
    depth: np.ndarray | None
    median_depth: np.ndarray | None
    normals: np.ndarray | None
    features: np.ndarray | None
    radii: np.ndarray | None
    contributions: Contributions | None
    _tape: _Tape


@dataclass(frozen=True)
class _Tape:
    """State that `backward` needs from `forward`."""

    made_by: tuple[type[Backend], CompositorName]
    parameters: Parameters
    camera: Camera
    background: np.ndarray
    channels: Channels
    composite: Composite


@dataclass(frozen=True)
class RasterGradient:
    """Gradient of a loss with respect to all inputs of an image; 0 for Gaussians that are not visible.

    Attributes:
        means, log_scales: (N, 3).
        rotations: (N, 3) in the tangent space, q ← q ⊗ exp(½δ), as the engines' optimiser expects.
        quaternions: (N, 4) with respect to the given quaternions, of any length.
        opacity_logits: (N,).
        sh: (N, K, 3).
        features: (N, D), or None.
        background: (3,) RGB.
        pose: (6,) with respect to ξ = (τ, ω) at 0, where world_to_camera becomes exp(ξ) world_to_camera: a shift along
            the camera's axes, then a rotation vector about them. None unless requested.
        world_to_camera: (3, 4) the same as a gradient with respect to the matrix's upper rows.
        centres: (N, 2) with respect to the centres on the image, in pixels.
        absolute_centres: (N, 2) magnitudes summed over pixels (AbsGS). None unless requested.
    """

    means: np.ndarray
    log_scales: np.ndarray
    rotations: np.ndarray
    quaternions: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray
    features: np.ndarray | None
    background: np.ndarray
    pose: np.ndarray | None
    world_to_camera: np.ndarray | None
    centres: np.ndarray
    absolute_centres: np.ndarray | None


class Rasterizer:
    """Renders Gaussians, and differentiates the renderings. Calls are independent of each other.

    Args:
        engine: "cpu"; "webgpu", which keeps GPU memory of the last image; or "reference", which computes in float64,
            readably and slowly.
        threads: CPU threads, or None for one per core.
        gpu: part of the name of the GPU to use, or None for the best.
        compositor: how splats on a pixel are combined. "over" blends them front to back, Σ c_i α_i T_i; "sum" adds
            them without sorting, Σ c_i α_i, with α less 1/255. The transmittance of both is Π (1 - α_i), but "over"
            stops at 1e-4. `pocketgs.sort_free` makes images from sums.

    Raises:
        PocketGSError: there is no such engine, compositor or GPU, or fewer than one thread is asked for.
    """

    def __init__(
        self,
        engine: Literal["cpu", "webgpu", "reference"] = "cpu",
        threads: int | None = None,
        gpu: str | None = None,
        compositor: CompositorName = "over",
    ) -> None:
        if compositor not in COMPOSITORS:
            raise PocketGSError(f"rasterizer: found compositor {compositor!r}, expected {' or '.join(COMPOSITORS)}")
        check_threads(threads)
        if gpu is not None and engine != "webgpu":
            raise PocketGSError(f"rasterizer: found GPU {gpu!r} with engine {engine!r}, expected it with webgpu only")
        self._compositor = compositor
        self._backend: Backend
        if engine == "cpu":
            from pocketgs.splat.cpu.rasterizer import CpuBackend

            self._backend = CpuBackend(threads, compositor)
        elif engine == "webgpu":
            from pocketgs.splat.webgpu.rasterizer import WebGpuBackend

            self._backend = WebGpuBackend(gpu, compositor)
        elif engine == "reference":
            from pocketgs.splat.reference.rasterizer import ReferenceBackend

            self._backend = ReferenceBackend(compositor)
        else:
            raise PocketGSError(f"rasterizer: found engine {engine!r}, expected cpu, webgpu or reference")
        self._kind = (type(self._backend), compositor)

    def forward(
        self,
        parameters: Parameters,
        camera: Camera,
        outputs: Output | Iterable[Output] = ("rgb",),
        *,
        features: np.ndarray | None = None,
        background: Background = BLACK,
        near: float | None = None,
        antialiased: bool = False,
    ) -> Raster:
        """Render one view. Only the requested outputs are computed.

        Args:
            parameters: the Gaussians; not copied, so do not change them until `backward` has been called.
            camera: of the view.
            outputs: one or more of OUTPUTS; see `Raster`.
            features: (N, D), any D, for the output "features": features, or colours computed elsewhere. All finite: NaN
                and infinity spread to pixels that the Gaussian does not touch.
            background: RGB behind the scene, for the output "rgb".
            near: minimum depth of the centre of a drawn Gaussian, at least 0; None for the default relative to the
                scene.
            antialiased: whether Gaussians smaller than a pixel fade instead of becoming more opaque: opacities are
                multiplied by √(det Σ / det(Σ + 0.3 I)), as gsplat's rasterize_mode "antialiased" and Mip-Splatting's 2D
                filter.

        Raises:
            PocketGSError: an output is unknown or not of this compositor, features do not have one row per Gaussian, or
                the near plane is negative or not finite.
        """
        names: tuple[Output, ...] = (outputs,) if isinstance(outputs, str) else tuple(outputs)
        if unknown := [name for name in names if name not in OUTPUTS]:
            raise PocketGSError(f"rasterizer: found output {unknown[0]!r}, expected some of {', '.join(OUTPUTS)}")
        self._check_occlusion(names)
        channels = channels_of(parameters, camera, names, features, self._backend.dtype)
        near = near_plane(parameters.means) if near is None else _checked_near(near)
        composite = self._backend.forward(
            parameters, camera, near, channels.rgb is not None, channels.values, antialiased
        )
        behind = np.array(checked_background(background), self._backend.dtype)
        tape = _Tape(self._kind, parameters, camera, behind, channels, composite)
        images = channels.images(composite.image, composite.transmittance, behind)
        radii = contributions = median_depth = None
        if "radii" in names:
            radii = _scattered(len(parameters.means), composite.visible, composite.radii)
        if "contributions" in names or "median_depth" in names:
            contributions, median_depth = self._backend.inspect(composite)
        return Raster(
            rgb=images.rgb,
            alpha=1.0 - composite.transmittance if "alpha" in names else None,
            depth=images.depth,
            median_depth=median_depth if "median_depth" in names else None,
            normals=images.normals,
            features=images.features,
            radii=radii,
            contributions=contributions if "contributions" in names else None,
            _tape=tape,
        )

    def contributions(
        self, parameters: Parameters, cameras: Iterable[Camera], *, near: float | None = None
    ) -> Iterator[Contributions]:
        """Contributions of each Gaussian to each camera's image, in turn: the output "contributions" of many views.

        A GPU gets the Gaussians once and sends no images, so this is faster there than `forward` by view.

        Args:
            parameters: the Gaussians; do not change them before the last camera's turn.
            cameras: of the views.
            near: as for `forward`.

        Raises:
            PocketGSError: the compositor is not "over", or the near plane is negative or not finite.
        """
        self._check_occlusion(["contributions"])
        near = near_plane(parameters.means) if near is None else _checked_near(near)
        return self._backend.contributions(parameters, cameras, near)

    def _check_occlusion(self, outputs: Sequence[Output]) -> None:
        """Refuse outputs that depend on occlusion, unless the compositor knows it."""
        hiding = [name for name in outputs if name in HIDING]
        if hiding and self._compositor != "over":
            raise PocketGSError(f"rasterizer: found output {hiding[0]!r}, which needs the compositor over")

    def backward(
        self,
        raster: Raster,
        *,
        rgb: np.ndarray | None = None,
        alpha: np.ndarray | None = None,
        depth: np.ndarray | None = None,
        normals: np.ndarray | None = None,
        features: np.ndarray | None = None,
        pose: bool = False,
        absolute: bool = False,
    ) -> RasterGradient:
        """Compute gradients with respect to the inputs from gradients with respect to the outputs.

        Args:
            raster: what `forward` returned.
            rgb: (H, W, 3) gradient with respect to the output of that name, as the following; None counts as 0.
            alpha: (H, W), even if that output was not requested.
            depth: (H, W).
            normals: (H, W, 3).
            features: (H, W, D).
            pose: whether to compute the gradient with respect to the camera's pose.
            absolute: whether to sum the magnitudes of gradients with respect to centres on the image.

        Raises:
            PocketGSError: another engine or compositor made the image, or a gradient belongs to an output that was not
                requested, or has another shape.
        """
        tape = raster._tape
        if tape.made_by != self._kind:
            raise PocketGSError("rasterizer: found an image of another engine or compositor, expected one of these")
        channels, composite, parameters = tape.channels, tape.composite, tape.parameters
        given = {"rgb": rgb, "depth": depth, "normals": normals, "features": features, "alpha": alpha}
        d_image, d_transmittance = channels.d_images(
            given, composite.image, composite.transmittance, tape.background, self._backend.dtype
        )
        found = self._backend.backward(composite, d_image, d_transmittance, absolute)
        d_means = found.means + channels.d_means(found.channels, parameters.means, tape.camera)
        d_pose = None
        if pose:
            seen = composite.visible
            d_pose = pose_gradient(
                tape.camera,
                parameters.means[seen].astype(np.float64),
                rotation_matrices(parameters.quaternions[seen].astype(np.float64)),
                parameters.sh[seen],
                d_means[seen],
                found.rotations[seen],
                found.sh[seen],
            )
        d_rotations = found.rotations + channels.d_rotations(found.channels)
        return RasterGradient(
            means=d_means,
            log_scales=found.log_scales,
            rotations=d_rotations,
            quaternions=quaternion_gradient(parameters.quaternions, d_rotations).astype(self._backend.dtype),
            opacity_logits=found.opacity_logits,
            sh=found.sh,
            features=None if channels.features is None else found.channels[:, channels.features],
            background=np.zeros(3) if rgb is None else np.einsum("hw,hwc->c", composite.transmittance, rgb),
            pose=d_pose,
            world_to_camera=None if d_pose is None else matrix_gradient(tape.camera, d_pose),
            centres=found.centres,
            absolute_centres=found.absolute_centres if absolute else None,
        )


def _checked_near(near: float) -> float:
    if not 0.0 <= near < math.inf:
        raise PocketGSError(f"rasterizer: found a near plane at {near}, expected a depth of at least 0")
    return near


def _scattered(count: int, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    array = np.zeros((count, *values.shape[1:]), values.dtype)
    array[rows] = values
    return array
