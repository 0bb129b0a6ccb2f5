"""The CPU engine's backend of the rasterizer: the kernels of a training step, for any number of channels."""

from __future__ import annotations

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
from pocketgs.splat.cpu.rasterize_backward import sums_per_intersection
from pocketgs.splat.cpu.statistics import STATISTICS
from pocketgs.splat.diverged import suspects, without_diverged
from pocketgs.splat.ellipse import half_sizes
from pocketgs.splat.limits import TRAINING
from pocketgs.system.cores import kernel_threads

_NO_STATISTICS = np.empty((0, STATISTICS), np.float32)


@dataclass(frozen=True)
class _Tape:
    scene: SceneArrays
    coefficients: int
    view: View
    lens: KernelLens
    channels: int
    splats: np.ndarray
    visible: np.ndarray
    lists: TileLists
    image: np.ndarray
    transmittance: np.ndarray
    drawn_ends: np.ndarray


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
        scene = Gaussians(*(getattr(parameters, name) for name in PARAMETERS))
        scene.quaternions = np.ascontiguousarray(scene.unit_quaternions)
        if not colours:
            scene = without_diverged(scene, suspects(scene), camera)
        arrays = SceneArrays.of(scene)
        if not colours:
            arrays = arrays._replace(sh=np.empty((len(scene), 0, 3), np.float32))
        view, lens, count = View.of(camera, antialiased), kernel_lens(camera), len(scene)
        shown = COLOURS if colours else 0
        composited = shown + channels.shape[1]
        # The backward pass needs at least three channels.
        splats = np.zeros((count, FIRST_CHANNEL + max(composited, COLOURS)), np.float32)
        splats[:, FIRST_CHANNEL + shown : FIRST_CHANNEL + composited] = channels
        depth_keys, buffers = np.zeros(count, np.uint32), np.zeros((3, count), np.int32)
        clusters = Clusters(count).in_view(scene, view, lens, near, self.threads)
        project(
            arrays,
            view,
            lens,
            near,
            clusters,
            self.threads,
            splats,
            depth_keys,
        )
        visible, order = self._compositor.order(depth_keys, clusters, *buffers)
        lists = _copied(self._binner.bin(splats, visible, order, view))
        shape = (view.height, view.width)
        image = np.empty((splats.shape[1] - FIRST_CHANNEL, *shape), np.float32)
        transmittance, drawn_ends = np.empty(shape, np.float32), np.empty(view.tiles, np.int32)
        background = np.zeros(len(image), np.float32)
        self._compositor.forward(
            splats,
            lists.intersections,
            lists.ranges,
            background,
            TRAINING,
            self.threads,
            image,
            transmittance,
            drawn_ends,
        )
        drawn = splats[visible]
        radii = half_sizes(drawn[:, LOG2_OPACITY], drawn[:, EXPONENT_XX : EXPONENT_YY + 1])
        coefficients = scene.sh.shape[1]
        tape = _Tape(
            arrays, coefficients, view, lens, composited, splats, visible, lists, image, transmittance, drawn_ends
        )
        return Composite(image[:composited], transmittance, visible, radii, tape)

    def backward(
        self, composite: Composite, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> CompositeGradient:
        """Rasterize backward → project backward."""
        numba.set_num_threads(self.threads)
        tape: _Tape = composite.tape
        lists = tape.lists
        d_channel_images = np.zeros_like(tape.image)
        d_channel_images[: tape.channels] = d_image
        row = sums_per_intersection(len(tape.image))
        intersection_sums = np.empty(len(lists.intersections) * row, np.float32)
        self._compositor.replay(
            tape.splats,
            lists.intersections,
            lists.ranges,
            tape.drawn_ends,
            TRAINING,
            self.threads,
            tape.image,
            d_channel_images,
            tape.transmittance,
            d_transmittance,
            absolute,
            intersection_sums,
        )
        count, coefficients = len(tape.scene.means), tape.coefficients
        gradients = np.zeros((count, GRADIENT_SH + 3 * coefficients), np.float32)
        centres, channels = np.zeros((count, 4), np.float32), np.zeros((count, len(tape.image)), np.float32)
        project_backward(
            tape.scene,
            tape.view,
            tape.lens,
            self.threads,
            tape.splats,
            tape.visible,
            lists.slots,
            row,
            intersection_sums,
            _NO_STATISTICS,
            gradients,
            centres,
            channels,
        )
        return CompositeGradient(
            gradients[:, GRADIENT_MEAN:GRADIENT_LOG_SCALE],
            gradients[:, GRADIENT_LOG_SCALE:GRADIENT_ROTATION],
            gradients[:, GRADIENT_ROTATION:GRADIENT_OPACITY],
            gradients[:, GRADIENT_OPACITY],
            gradients[:, GRADIENT_SH:].reshape(count, coefficients, 3),
            channels[:, : tape.channels],
            centres[:, :2],
            centres[:, 2:],
        )

    def inspect(self, composite: Composite) -> tuple[Contributions, np.ndarray]:
        """Contributions of each Gaussian, and the median depth."""
        numba.set_num_threads(self.threads)
        tape: _Tape = composite.tape
        assert self._compositor.inspect is not None
        by_intersection = np.zeros((len(tape.lists.intersections), 3), np.float32)
        median = np.empty_like(tape.transmittance)
        self._compositor.inspect(
            tape.splats,
            tape.lists.intersections,
            tape.lists.ranges,
            tape.drawn_ends,
            tape.view.width,
            self.threads,
            by_intersection,
            median,
        )
        found = np.zeros((len(tape.scene.means), 3), np.float32)
        gather_contributions(tape.visible, tape.lists.slots, by_intersection, found)
        pixels, largest, summed = (found[:, column].copy() for column in (PIXELS, LARGEST, SUMMED))
        return Contributions(pixels.astype(np.int32), largest, summed), median

    def contributions(self, parameters: Parameters, cameras: Iterable[Camera], near: float) -> Iterator[Contributions]:
        """Contributions of each Gaussian to each camera's image, in turn."""
        return contributions_in_turn(self, parameters, cameras, near)
