"""The CPU engine: owns the scene's arrays and calls the kernels of a step in order."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import PINHOLE, Lens
from pocketgs.scene.background import BLACK, Background, checked_background
from pocketgs.scene.gaussians import PARAMETERS, SH_COEFFICIENTS, Gaussians
from pocketgs.splat.checks import check_state, check_view, checked_scene
from pocketgs.splat.cpu.adam import regularise, update
from pocketgs.splat.cpu.bin import Binner, TileLists
from pocketgs.splat.cpu.clusters import Clusters, clear
from pocketgs.splat.cpu.compositor import OVER
from pocketgs.splat.cpu.dropout import drop_out
from pocketgs.splat.cpu.errors import error_sums
from pocketgs.splat.cpu.lanes import LANES
from pocketgs.splat.cpu.layout import BLUE, DEPTH, RED, SceneArrays, View
from pocketgs.splat.cpu.lenses.lens import KernelLens, Pinhole, kernel_lens
from pocketgs.splat.cpu.memory import training_bytes
from pocketgs.splat.cpu.noise import add_noise
from pocketgs.splat.cpu.photographs import Canvas, Photographs, TrainingView
from pocketgs.splat.cpu.project import project
from pocketgs.splat.cpu.project_backward import project_backward
from pocketgs.splat.cpu.splat_buffers import SplatBuffers
from pocketgs.splat.cpu.statistics import RADIUS, SCREEN_GRADIENT, SEEN, STATISTICS
from pocketgs.splat.engine import KEPT_LOSSES, OptimiserState, Rendering
from pocketgs.splat.limits import TRAINING
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import RowChange, Statistics
from pocketgs.splat.settings import ColourSettings, Dropout, LearningRates, PositionNoise, StepSettings
from pocketgs.splat.store import ParameterStore
from pocketgs.splat.timing import NoTimer, PassTimer
from pocketgs.system.compiled_variants import note_compiled
from pocketgs.system.cores import kernel_threads
from pocketgs.system.device import MemoryNeed

_NO_PLANE, _NO_CENTRES, _NO_CHANNELS = (np.empty(shape, np.float32) for shape in ((0, 0), (0, 4), (0, 3)))
"""Empty arrays for unused optional arguments of kernels."""


@dataclass(frozen=True)
class ForwardPass:
    """Results of the forward pass for the backward pass; overwritten by the next forward pass."""

    clusters: np.ndarray
    visible: np.ndarray
    order: np.ndarray
    lists: TileLists
    canvas: Canvas


NOTHING = Gaussians(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0), np.zeros((0, 1, 3)))
"""The scene before the first upload."""


class CpuEngine:
    """Operator T in Numba; see `pocketgs.splat.engine.Engine`.

    Args:
        threads: number of threads, or None for one per core that this process may use.

    Attributes:
        timer: set it to a `PassTimer` to time the passes of steps.
    """

    name = "cpu"

    def __init__(self, threads: int | None = None) -> None:
        self.threads = kernel_threads(threads)
        self.device = f"CPU, {self.threads} threads"
        self._binner = Binner(self.threads)
        self._canvas: Canvas | None = None
        self._intersection_sums = np.empty(0, np.float32)
        self.timer: PassTimer = NoTimer()
        self._losses: deque[float] = deque(maxlen=KEPT_LOSSES)
        self._photographs = Photographs([], self.threads)
        self.upload(NOTHING)

    def prepare(self) -> None:
        """Compile the kernels, or load them from the cache, by training a dummy scene.

        Kernels of lenses are compiled in `set_views`, when the lenses are known.
        """
        self._prepare_for(PINHOLE)

    def _prepare_for(self, lens: Lens) -> None:
        corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        scene = Gaussians(corner, np.zeros((4, 3)), np.ones((4, 4)), np.zeros(4), np.zeros((4, 1, 3)))
        pose = np.eye(4)
        pose[2, 3] = 4.0
        camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, pose, lens)
        rates = LearningRates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        noise, dropout, colours = PositionNoise(0.0, 0), Dropout(0.0, 0), ColourSettings(0.0)
        settings = StepSettings(rates, statistics=True, noise=noise, dropout=dropout, colours=colours)
        engine = CpuEngine(self.threads)
        engine._set_views([Frame("", camera, np.zeros((16, 16, 3), np.uint8))])
        engine.upload(scene)
        engine.step(0, settings)

    def set_views(self, frames: Sequence[Frame]) -> None:
        """Set the photographs that `step` indexes."""
        self._set_views(frames)
        kinds = {
            type(view.lens): frame.camera.lens for view, frame in zip(self._photographs.views, frames, strict=True)
        }
        for kind, lens in kinds.items():
            if kind is not Pinhole:
                self._prepare_for(lens)
                note_compiled("splat.cpu", lens.model)

    def set_masks(self, masks: Sequence[np.ndarray | None]) -> None:
        """Replace the photographs' masks."""
        self._photographs.set_masks(masks)

    def _set_views(self, frames: Sequence[Frame]) -> None:
        self._photographs = Photographs(frames, self.threads)

    def upload(self, gaussians: Gaussians, state: OptimiserState | None = None) -> None:
        """Copy the scene, and the optimiser's state; without one, the optimiser is reset."""
        gaussians = checked_scene(gaussians)
        if state is not None:
            check_state(gaussians, state)
        self._photographs.restart_colours(None if state is None else state.colours)
        self._store = ParameterStore(gaussians, state)
        self._losses.clear()
        self._near = near_plane(gaussians.means) if state is None or state.near is None else state.near
        self._steps = 0 if state is None else state.steps
        self._allocate_rows()

    def _allocate_rows(self) -> None:
        """Allocate a step's outputs per Gaussian for the current number of Gaussians."""
        count = self._store.count
        self.restart_statistics()
        self._buffers = SplatBuffers(count)
        self._clusters = Clusters(count)
        # Clusters with non-zero gradients; after a change of rows, gradients are undefined.
        self._written = self._clusters.all

    @property
    def count(self) -> int:
        """Number of Gaussians."""
        return self._store.count

    def change_rows(self, change: RowChange) -> None:
        """Select, duplicate and set Gaussians."""
        self._store.change_rows(change)
        self._allocate_rows()

    def statistics(self) -> Statistics:
        """Sums over steps so far."""
        found = Statistics.none_yet(self.count)
        if len(self._statistics):
            columns = (SCREEN_GRADIENT, SEEN, RADIUS)
            gradients, seen, radii = (self._statistics[:, column].copy() for column in columns)
            found = Statistics(gradients, seen, radii, found.errors)
        return replace(found, errors=self._errors.copy()) if len(self._errors) else found

    def restart_statistics(self, start: Statistics | None = None) -> None:
        """Restart the statistics at zero, or from earlier sums."""
        self._statistics = np.zeros((0 if start is None else self.count, STATISTICS), np.float32)
        if start is not None:
            self._statistics[:, SCREEN_GRADIENT] = start.screen_gradients
            self._statistics[:, SEEN] = start.seen
            self._statistics[:, RADIUS] = start.radii
        self._errors = np.zeros(0, np.float32) if start is None else start.errors.copy()

    def step(self, view: int, settings: StepSettings) -> None:
        """Train on one view."""
        check_view(view, self._photographs.views)
        numba.set_num_threads(self.threads)
        training_view = self._photographs.views[view]
        background = np.array(settings.background, np.float32)
        raster = self._forward(training_view.view, training_view.lens, background, settings.dropout)
        self.timer.begins("loss")
        loss = self._photographs.compare(view, raster.canvas, settings)
        if settings.statistics and len(self._statistics) == 0:
            self._statistics = np.zeros((self.count, STATISTICS), np.float32)
        self._backward(training_view, raster, settings)
        if settings.errors:
            self._add_errors(view, raster, settings)
        self._losses.append(loss + self._update(settings, raster.clusters))

    def loss(self, steps: int = 1) -> float:
        """Mean loss of the last `steps` steps, measured before their updates."""
        return float(np.mean(list(self._losses)[-steps:])) if self._losses else math.nan

    def render(self, camera: Camera, background: Background = BLACK, depth: bool = False) -> Rendering:
        """Render the current scene."""
        numba.set_num_threads(self.threads)
        view = View.of(camera)
        raster = self._forward(view, kernel_lens(camera), np.array(checked_background(background), np.float32))
        image = np.moveaxis(raster.canvas.image, 0, 2).copy()
        alpha = 1.0 - raster.canvas.transmittance
        expected_depth = None
        if depth:
            # Depth is composited like a colour.
            splats = self._buffers.splats
            splats[:, RED : BLUE + 1] = splats[:, DEPTH : DEPTH + 1]
            total = self._rasterize(view, raster.lists, np.zeros(3, np.float32)).image[0]
            expected_depth = np.divide(total, alpha, out=np.zeros_like(alpha), where=alpha > 0.0)
        return Rendering(image, alpha, expected_depth)

    def download(self) -> Gaussians:
        """Copy the current scene."""
        return Gaussians(*(self._store[name].copy() for name in PARAMETERS))

    def optimiser_state(self) -> OptimiserState:
        """Copy the optimiser's state."""
        store = self._store
        colours = self._photographs.colours
        return OptimiserState(store.first_moments.copy(), store.second_moments.copy(), self._steps, self._near, colours)

    def memory(self) -> dict[str, int]:
        """Bytes that the engine holds, by purpose."""
        return {
            "photographs": self._photographs.nbytes,
            **self._store.nbytes(),
            "tile lists": self._binner.nbytes,
            "gradients by tile": self._intersection_sums.nbytes,
            "statistics": self._statistics.nbytes + self._errors.nbytes,
            "clusters": self._clusters.nbytes,
            "projected splats": self._buffers.nbytes,
        }

    def memory_needed(self, gaussians: int, coefficients: int, photographs: Sequence[tuple[int, int]]) -> MemoryNeed:
        """Estimate the memory needed for training."""
        return MemoryNeed(training_bytes(gaussians, coefficients, photographs))

    def _forward(
        self, view: View, lens: KernelLens, background: np.ndarray, dropout: Dropout | None = None
    ) -> ForwardPass:
        """Cull → project → drop out → sort → bin → rasterize."""
        scene, buffers, timer = self._store.scene, self._buffers, self.timer
        timer.begins("cull")
        clusters = self._clusters.in_view(scene, view, lens, self._near, self.threads)
        timer.begins("project")
        arrays = SceneArrays.of(scene)
        project(arrays, view, lens, self._near, clusters, self.threads, buffers.splats, buffers.depth_keys)
        if dropout is not None:
            timer.begins("drop out")
            drop_out(buffers.depth_keys, dropout.threshold, dropout.seed, self.threads)
        timer.begins("sort")
        visible, order = OVER.order(buffers.depth_keys, clusters, *buffers.orders)
        timer.begins("bin")
        lists = self._binner.bin(buffers.splats, visible, order, view)
        canvas = self._rasterize(view, lists, background)
        return ForwardPass(clusters, visible, order, lists, canvas)

    def _rasterize(self, view: View, lists: TileLists, background: np.ndarray) -> Canvas:
        """Draw the splats to the canvas, which is made anew for another size of image."""
        if self._canvas is None or self._canvas.shape != (view.height, view.width):
            self._canvas = Canvas(view)
        canvas = self._canvas
        self.timer.begins("rasterize")
        OVER.forward(self._buffers.splats, lists, background, TRAINING, self.threads, canvas.drawn)
        self.timer.ends()
        return canvas

    def _backward(self, view: TrainingView, raster: ForwardPass, settings: StepSettings) -> None:
        """Rasterize backward → project backward: writes the gradients."""
        self._rasterize_backward(raster)
        gradients = self._store.gradients
        self.timer.begins("project backward")
        clear(gradients, self._written, self.threads)
        self._written = raster.clusters
        project_backward(
            SceneArrays.of(self._store.scene),
            view.view,
            view.lens,
            self.threads,
            self._buffers.splats,
            raster.visible,
            raster.lists,
            LANES,
            self._intersection_sums,
            self._statistics if settings.statistics else self._statistics[:0],
            gradients,
            _NO_CENTRES,
            _NO_CHANNELS,
        )

    def _add_errors(self, view: int, raster: ForwardPass, settings: StepSettings) -> None:
        """Add each Gaussian's contribution to the view's error."""
        if len(self._errors) == 0:
            self._errors = np.zeros(self.count, np.float32)
        self._photographs.write_error(view, raster.canvas, settings)
        self._rasterize_backward(raster)
        self._errors[raster.visible] += error_sums(raster.visible, raster.lists, self._intersection_sums).astype(
            np.float32
        )

    def _rasterize_backward(self, raster: ForwardPass) -> None:
        """Write the sums of intersections from the canvas's gradient."""
        canvas, size = raster.canvas, len(raster.lists.intersections) * LANES
        if len(self._intersection_sums) < size:
            self._intersection_sums = np.empty(size * 5 // 4, np.float32)
        self.timer.begins("rasterize backward")
        kept = self._buffers.splats, raster.lists, TRAINING, self.threads, canvas.drawn
        OVER.backward(*kept, canvas.d_image, _NO_PLANE, False, self._intersection_sums)

    def _update(self, settings: StepSettings, in_view: np.ndarray) -> float:
        """Regularise → Adam; returns the regularisers' value."""
        scene, store, weights = self._store.scene, self._store, settings.loss
        self.timer.begins("Adam")
        value = 0.0
        moving = in_view if settings.adam.seen_only else self._clusters.all
        if len(scene) and (weights.scale_weight or weights.opacity_weight or weights.size_weight):
            value = regularise(
                scene.log_scales,
                scene.opacity_logits,
                weights.scale_weight,
                weights.opacity_weight,
                weights.size_weight,
                store.gradients,
            )
            moving = self._written = self._clusters.all
        layout = store.layout
        if settings.sh_degree is not None:
            trained = min(SH_COEFFICIENTS[settings.sh_degree], layout.coefficients)
            layout = ParameterLayout(trained)
        self._steps += 1
        update(store, layout.rates_by_column(settings.rates), settings.adam, self._steps, moving, self.threads)
        if settings.noise is not None:
            add_noise(SceneArrays.of(scene), settings.noise.size, settings.noise.seed, self.threads)
            moving = self._clusters.all
        self._clusters.have_moved(moving)
        self.timer.ends()
        return value
