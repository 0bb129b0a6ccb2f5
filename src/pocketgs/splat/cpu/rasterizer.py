"""The CPU engine's backend of the rasterizer: the kernels of a training step, for any number of channels."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.backend import Composite, CompositeGradient, Contributions, Parameters, contributions_in_turn
from pocketgs.splat.cpu.bin import Binner, TileLists
from pocketgs.splat.cpu.clusters import Clusters
from pocketgs.splat.cpu.compositor import COMPOSITORS
from pocketgs.splat.cpu.contributions import LARGEST, PIXELS, SUMMED, gather_contributions
from pocketgs.splat.cpu.layout import (
    COLOURS,
    EXPONENT_XX,
    EXPONENT_YY,
    FIRST_CHANNEL,
    GRADIENT_LOG_SCALE,
    GRADIENT_MEAN,
    GRADIENT_OPACITY,
    GRADIENT_ROTATION,
    GRADIENT_SH,
    LOG2_OPACITY,
    SceneArrays,
    View,
)
from pocketgs.splat.cpu.lenses.lens import KernelLens, kernel_lens
from pocketgs.splat.cpu.project import project
from pocketgs.splat.cpu.project_backward import project_backward
from pocketgs.splat.cpu.splat_buffers import SplatBuffers
from pocketgs.splat.cpu.statistics import STATISTICS
from pocketgs.splat.cpu.tile_image import TileImage
from pocketgs.splat.cpu.tile_sums import sums_per_intersection
from pocketgs.splat.diverged import suspects, without_diverged
from pocketgs.splat.ellipse import half_sizes
from pocketgs.splat.limits import TRAINING
from pocketgs.system.cores import kernel_threads

_NO_STATISTICS = np.empty((0, STATISTICS), np.float32)


@dataclass(frozen=True)
class _Tape:
    """State of an image for the passes that follow.

    Attributes:
        scene: the Gaussians; K = 0 if their colours were not composited.
        coefficients: K of the Gaussians themselves.
        view: the camera.
        lens: of the camera.
        channels: number of channels asked for; the image has at least three.
        splats: (N, FIRST_CHANNEL + C) from `project`.
        visible: (V,) int32 Gaussians that are drawn, in memory order.
        lists: their tile lists.
        drawn: the image.
    """

    scene: SceneArrays
    coefficients: int
    view: View
    lens: KernelLens
    channels: int
    splats: np.ndarray
    visible: np.ndarray
    lists: TileLists
    drawn: TileImage


def _scene_of(parameters: Parameters, camera: Camera, colours: bool) -> Gaussians:
    """The Gaussians with unit quaternions; without colours, those whose colour has diverged are transparent."""
    scene = Gaussians(*(getattr(parameters, name) for name in PARAMETERS))
    scene.quaternions = np.ascontiguousarray(scene.unit_quaternions)
    return scene if colours else without_diverged(scene, suspects(scene), camera)


def _copied(lists: TileLists) -> TileLists:
    """Lists that outlive the next image, for which the binner uses its memory again."""
    return TileLists(lists.intersections.copy(), lists.ranges, lists.slots.copy())


class CpuBackend:
    """See `pocketgs.splat.backend.Backend`.

    Args:
        threads: number of threads, or None for one per core that this process may use.
        compositor: name of the compositing rule, one of COMPOSITORS.
    """

    dtype: type[np.floating[Any]] = np.float32

    def __init__(self, threads: int | None = None, compositor: str = "over") -> None:
        self._compositor = COMPOSITORS[compositor]
        self.threads = kernel_threads(threads)
        self._binner = Binner(self.threads)
        # Another thread's lists would overwrite those that are not copied yet.
        self._binning = threading.Lock()

    def forward(
        self,
        parameters: Parameters,
        camera: Camera,
        near: float,
        colours: bool,
        channels: np.ndarray,
        antialiased: bool = False,
    ) -> Composite:
        """Project → order → bin → rasterize."""
        numba.set_num_threads(self.threads)
        scene = _scene_of(parameters, camera, colours)
        arrays, count = SceneArrays.of(scene), len(scene)
        if not colours:
            arrays = arrays._replace(sh=np.empty((count, 0, 3), np.float32))
        view, lens = View.of(camera, antialiased), kernel_lens(camera)
        shown = COLOURS if colours else 0
        composited = shown + channels.shape[1]
        # The backward pass needs at least three channels.
        buffers = SplatBuffers(count, max(composited, COLOURS))
        splats = buffers.splats
        splats[:, FIRST_CHANNEL + shown : FIRST_CHANNEL + composited] = channels
        clusters = Clusters(count).in_view(scene, view, lens, near, self.threads)
        project(arrays, view, lens, near, clusters, self.threads, splats, buffers.depth_keys)
        visible, order = self._compositor.order(buffers.depth_keys, clusters, *buffers.orders)
        with self._binning:
            lists = _copied(self._binner.bin(splats, visible, order, view))
        drawn = TileImage.empty(view, max(composited, COLOURS))
        black = np.zeros(len(drawn.image), np.float32)
        self._compositor.forward(splats, lists, black, TRAINING, self.threads, drawn)
        shapes = splats[visible, LOG2_OPACITY], splats[visible, EXPONENT_XX : EXPONENT_YY + 1]
        tape = _Tape(
            scene=arrays,
            coefficients=scene.sh.shape[1],
            view=view,
            lens=lens,
            channels=composited,
            splats=splats,
            visible=visible,
            lists=lists,
            drawn=drawn,
        )
        return Composite(drawn.image[:composited], drawn.transmittance, visible, half_sizes(*shapes), tape)

    def backward(
        self, composite: Composite, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> CompositeGradient:
        """Rasterize backward → project backward."""
        numba.set_num_threads(self.threads)
        tape: _Tape = composite.tape
        d_channel_images = np.zeros_like(tape.drawn.image)
        d_channel_images[: tape.channels] = d_image
        row = sums_per_intersection(len(d_channel_images))
        intersection_sums = np.empty(len(tape.lists.intersections) * row, np.float32)
        kept = tape.splats, tape.lists, TRAINING, self.threads, tape.drawn
        self._compositor.backward(*kept, d_channel_images, d_transmittance, absolute, intersection_sums)
        return self._project_backward(tape, row, intersection_sums)

    def _project_backward(self, tape: _Tape, row: int, intersection_sums: np.ndarray) -> CompositeGradient:
        """Gradients of the Gaussians from rows of sums of their intersections."""
        count, coefficients = len(tape.scene.means), tape.coefficients
        gradients = np.zeros((count, GRADIENT_SH + 3 * coefficients), np.float32)
        centres, channels = np.zeros((count, 4), np.float32), np.zeros((count, len(tape.drawn.image)), np.float32)
        project_backward(
            tape.scene,
            tape.view,
            tape.lens,
            self.threads,
            tape.splats,
            tape.visible,
            tape.lists,
            row,
            intersection_sums,
            _NO_STATISTICS,
            gradients,
            centres,
            channels,
        )
        return CompositeGradient(
            means=gradients[:, GRADIENT_MEAN:GRADIENT_LOG_SCALE],
            log_scales=gradients[:, GRADIENT_LOG_SCALE:GRADIENT_ROTATION],
            rotations=gradients[:, GRADIENT_ROTATION:GRADIENT_OPACITY],
            opacity_logits=gradients[:, GRADIENT_OPACITY],
            sh=gradients[:, GRADIENT_SH:].reshape(count, coefficients, 3),
            channels=channels[:, : tape.channels],
            centres=centres[:, :2],
            absolute_centres=centres[:, 2:],
        )

    def inspect(self, composite: Composite) -> tuple[Contributions, np.ndarray]:
        """Contributions of each Gaussian, and the median depth."""
        numba.set_num_threads(self.threads)
        tape: _Tape = composite.tape
        assert self._compositor.inspect is not None
        by_intersection = np.zeros((len(tape.lists.intersections), 3), np.float32)
        median = np.empty_like(tape.drawn.transmittance)
        self._compositor.inspect(tape.splats, tape.lists, tape.drawn, self.threads, by_intersection, median)
        found = np.zeros((len(tape.scene.means), 3), np.float32)
        gather_contributions(tape.visible, tape.lists.slots, by_intersection, found)
        pixels, largest, summed = (found[:, column].copy() for column in (PIXELS, LARGEST, SUMMED))
        return Contributions(pixels=pixels.astype(np.int32), largest=largest, summed=summed), median

    def contributions(self, parameters: Parameters, cameras: Iterable[Camera], near: float) -> Iterator[Contributions]:
        """Contributions of each Gaussian to each camera's image, in turn."""
        return contributions_in_turn(self, parameters, cameras, near)
