"""The WebGPU engine: keeps a run's state on the GPU, and submits a step's passes without waiting for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.gpu.adapters import DRIVER_BYTES, choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.scene.background import BLACK, Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.checks import check_masks, check_state, check_view, checked_scene
from pocketgs.splat.colours import check_transforms
from pocketgs.splat.engine import EngineOptions, OptimiserState, Rendering
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import RowChange, Statistics, checked_change
from pocketgs.splat.settings import StepSettings
from pocketgs.splat.webgpu.drawing import draw_once, make_room_for, rendered, write_camera
from pocketgs.splat.webgpu.frame_values import is_regularised, step_values, structural_share, update_values
from pocketgs.splat.webgpu.layout import SUM_WORDS
from pocketgs.splat.webgpu.lenses import LENSES, lens_symbols
from pocketgs.splat.webgpu.memory import (
    GROWTH,
    INTERSECTIONS_PER_GAUSSIAN,
    MIN_INTERSECTIONS,
    Extent,
    MemoryLimits,
    MemoryPlan,
    expected_extent,
    plan_memory,
    plan_rows,
    plan_run,
)
from pocketgs.splat.webgpu.passes import describe_training
from pocketgs.splat.webgpu.photographs import PIXEL_BYTES, packed
from pocketgs.splat.webgpu.row_changes import gather_rows, set_values
from pocketgs.splat.webgpu.steps_ahead import Step, StepsAhead
from pocketgs.splat.webgpu.tables import (
    read_optimiser_state,
    read_scene,
    read_statistics,
    write_optimiser_state,
    write_scene,
    write_statistics,
)
from pocketgs.splat.webgpu.variant import Variant
from pocketgs.system.device import MB, MemoryNeed

INTERSECTION_BYTES = {"ordered": 4 * SUM_WORDS, "atomic": 4}
"""Bytes per intersection of the largest buffer that grows with intersections."""


class WebGpuEngine:
    """Operator T in compute shaders; see `pocketgs.splat.engine.Engine`.

    Steps are submitted and not waited for. A step whose tile lists do not fit into their buffers changes nothing, and
    neither do the steps after it: at its next check, the host enlarges the buffers and submits them again. The result
    of a run does not depend on how often that happens.

    Args:
        options: device and settings; None for the defaults.

    Raises:
        PocketGSError: there is no such device, or it lacks a feature.
    """

    name = "webgpu"
    _extent: Extent
    _plan: MemoryPlan

    def __init__(self, options: EngineOptions | None = None) -> None:
        options = options or EngineOptions()
        adapter = choose_adapter(options.gpu)
        self.device = f"{adapter.name}, {adapter.backend}"
        subgroups = "subgroup" in adapter.features and not options.portable
        variant = Variant(options.precision, options.replay, options.accumulation, subgroups, lenses=LENSES)
        self.executor = Executor(shared_device(adapter, variant.features), describe_training(variant))
        self._shares_memory = adapter.shares_memory
        self._limits = MemoryLimits(options.max_memory * MB, adapter.largest_buffer)
        self._frames: list[Frame] = []
        self._near = near_plane(np.zeros((0, 3)))
        self._ahead = StepsAhead(self.executor)
        self._most_intersections = adapter.largest_buffer // INTERSECTION_BYTES[options.accumulation]
        self._fit(Extent(), [])

    def prepare(self) -> None:
        """Compile all pipelines."""
        self.executor.prepare()

    def set_views(self, frames: Sequence[Frame]) -> None:
        """Set the photographs that `step` indexes.

        Raises:
            PocketGSError: training on them exceeds the GPU's memory.
        """
        self._settle()
        sizes = tuple((frame.camera.width, frame.camera.height) for frame in frames)
        self._fit(replace(self._extent, photographs=sizes, drawn_sizes=frozenset(), trains=True), frames)
        self.executor.clear("colours")

    def set_masks(self, masks: Sequence[np.ndarray | None]) -> None:
        """Replace the photographs' masks."""
        check_masks(masks, self._extent.photographs)
        self._settle()
        # The same array may hold other values than before.
        masked = [view for view, mask in enumerate(masks) if not (mask is None and self._frames[view].mask is None)]
        self._frames = [replace(frame, mask=mask) for frame, mask in zip(self._frames, masks, strict=True)]
        self._shelve(masked)

    def upload(self, gaussians: Gaussians, state: OptimiserState | None = None) -> None:
        """Copy the scene, and the optimiser's state; without one, the optimiser is reset.

        Raises:
            PocketGSError: it exceeds the GPU's memory.
        """
        gaussians = checked_scene(gaussians)
        if state is not None:
            check_state(gaussians, state)
            if state.colours is not None:
                check_transforms(state.colours, len(self._extent.photographs))
        count, coefficients = len(gaussians), gaussians.sh.shape[1]
        trains = self._extent.trains or state is not None
        extent = replace(self._extent, gaussians=count, capacity=count, coefficients=coefficients, trains=trains)
        self._fit_intersections(extent, INTERSECTIONS_PER_GAUSSIAN * count, MIN_INTERSECTIONS)
        self._ahead.restart(state.steps if state else 0)
        self._near = near_plane(gaussians.means) if state is None or state.near is None else state.near
        write_scene(self.executor, gaussians)
        if trains:
            write_optimiser_state(self.executor, state)
            self.restart_statistics()

    @property
    def count(self) -> int:
        """Number of Gaussians."""
        return self._extent.gaussians

    def change_rows(self, change: RowChange) -> None:
        """Select, duplicate and set Gaussians, including the optimiser's rows. Statistics restart at zero.

        Raises:
            PocketGSError: the change does not fit the scene, or the result does not fit into memory.
        """
        self._settle()
        change = checked_change(change, self.count, ParameterLayout(self._extent.coefficients))
        if not self._extent.trains:
            self._fit(replace(self._extent, trains=True))
        description, before = self.executor.description, self.count
        extent, plan = plan_rows(description, self._extent, len(change.sources), self._limits)
        symbols = description.symbols({**extent.symbols, "width": 1, "height": 1})
        gather_rows(self.executor, change, before, symbols, plan.sizes)
        self._fit(extent)
        set_values(self.executor, change, symbols)
        self.executor.clear("cluster_bounds")
        self.restart_statistics()

    def statistics(self) -> Statistics:
        """Sums over the steps with `StepSettings.statistics` since the last change of rows or restart."""
        self._settle()
        if not self._extent.trains:
            return Statistics.none_yet(self.count)
        return read_statistics(self.executor, self.count)

    def restart_statistics(self, start: Statistics | None = None) -> None:
        """Restart the statistics at zero, or from earlier sums."""
        self._settle()
        if not self._extent.trains:
            self._fit(replace(self._extent, trains=True))
        write_statistics(self.executor, start)

    def step(self, view: int, settings: StepSettings) -> None:
        """Train on one view. Returns before the step is complete."""
        check_view(view, self._frames)
        self._submit(Step(view, settings))
        if self._ahead.are_enough(streamed=not self._plan.shelf.is_resident(view)):
            self._settle()

    def loss(self, steps: int = 1) -> float:
        """Mean loss of the last `steps` steps, measured before their updates."""
        self._settle()
        return self._ahead.mean_loss(steps)

    def render(self, camera: Camera, background: Background = BLACK, depth: bool = False) -> Rendering:
        """Render the current scene."""
        return rendered(self._draw, camera, background, depth)

    def download(self) -> Gaussians:
        """Copy the current scene."""
        self._settle()
        return read_scene(self.executor, self.count, self._extent.coefficients)

    def optimiser_state(self) -> OptimiserState:
        """Copy the optimiser's state."""
        self._settle()
        coefficients, photographs = self._extent.coefficients, len(self._extent.photographs)
        if not self._extent.trains:
            zeros = np.zeros((self.count, ParameterLayout(coefficients).columns), np.float32)
            return OptimiserState(zeros, zeros.copy(), self._ahead.completed, self._near)
        first, second, colours = read_optimiser_state(self.executor, self.count, coefficients, photographs)
        return OptimiserState(first, second, self._ahead.completed, self._near, colours)

    def memory(self) -> dict[str, int]:
        """Bytes of each buffer on the GPU, by its name in the passes."""
        return self.executor.sizes()

    def memory_needed(self, gaussians: int, coefficients: int, photographs: Sequence[tuple[int, int]]) -> MemoryNeed:
        """Estimate the memory needed for training. If GPU and CPU share memory, buffers count as the process's too.

        Raises:
            PocketGSError: it exceeds the GPU's memory.
        """
        description = self.executor.description
        extent = expected_extent(gaussians, coefficients, photographs, self._most_intersections)
        uniforms = sum(layout.size for layout in description.uniforms.values())
        device = plan_run(description, extent, self._limits).total + uniforms
        return MemoryNeed(DRIVER_BYTES + (device if self._shares_memory else 0), device)

    def _symbols(self, camera: Camera, settings: StepSettings | None = None) -> dict[str, int]:
        """Compute the symbols of the passes of one image."""
        return self.executor.description.symbols(
            {
                **self._extent.symbols,
                "replay_depth": self._plan.replay_depth,
                "width": camera.width,
                "height": camera.height,
                **lens_symbols(camera),
                "structural": int(settings is not None and structural_share(settings, camera) > 0.0),
                "regularised": int(settings is not None and is_regularised(settings)),
                "collecting": int(settings is not None and settings.statistics),
            }
        )

    def _fit(self, extent: Extent, frames: Sequence[Frame] | None = None) -> None:
        """Allocate buffers for an extent. One that does not fit is refused before anything changes."""
        plan = plan_memory(self.executor.description, extent, self._limits)
        self.executor.reserve(plan.sizes)
        is_shelved = frames is None and plan.shelf == self._plan.shelf
        self._extent, self._plan = extent, plan
        self._frames = self._frames if frames is None else list(frames)
        if not is_shelved:
            self._shelve(range(len(self._frames)))

    def _shelve(self, views: Sequence[int]) -> None:
        """Upload those photographs that have a place of their own."""
        shelf = self._plan.shelf
        for view in views:
            if shelf.is_resident(view):
                self.executor.write("photographs", packed(self._frames[view]), PIXEL_BYTES * shelf.place(view))

    def _fit_intersections(self, extent: Extent, wanted: int, needed: int) -> None:
        """Allocate buffers with room for the wanted intersections, or at least for the needed ones."""

        def fit(intersections: int) -> None:
            self._fit(replace(extent, intersections=intersections))

        make_room_for(fit, max(needed, min(wanted, self._most_intersections)), needed)

    def _submit(self, step: Step) -> None:
        frame, shelf = self._frames[step.view], self._plan.shelf
        camera, place = frame.camera, shelf.place(step.view)
        if not shelf.is_resident(step.view):
            self.executor.write("photographs", packed(frame), PIXEL_BYTES * place)
        settings, number = step.settings, self._ahead.next_number
        symbols, of_step = self._symbols(camera, settings), step_values(settings, place)
        write_camera(self.executor, camera, settings.background, self._near, symbols, of_step)
        self.executor.write_uniform("update", update_values(settings, camera, symbols, number, step.view))
        self.executor.submit("step", symbols)
        if settings.errors:
            self.executor.submit("errors", symbols)
        if settings.colours is not None:
            self.executor.submit("learn colours", symbols)
        self._ahead.add(step)

    def _settle(self) -> None:
        """Wait until all steps are completed."""
        self._ahead.settle(self._submit, self._make_room)

    def _make_room(self, needed: int) -> None:
        """Enlarge the tile lists to `needed` intersections and some more, and let the run continue."""
        try:
            self._fit_intersections(self._extent, int(needed * GROWTH), needed)
        finally:
            self._ahead.resume()

    def _draw(self, sequence: str, camera: Camera, background: Background) -> np.ndarray:
        """(H, W, 4) float32: colour and transmittance."""
        self._settle()
        size = (camera.width, camera.height)
        if size not in self._extent.drawn_sizes:
            self._fit(replace(self._extent, drawn_sizes=self._extent.drawn_sizes | {size}))
        while True:
            symbols = self._symbols(camera)
            image, needed = draw_once(self.executor, sequence, camera, background, self._near, symbols)
            if not needed:
                return image
            self._make_room(needed)
