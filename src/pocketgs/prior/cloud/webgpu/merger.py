"""Merging on a GPU."""

from __future__ import annotations

import numpy as np

from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.buffer_sizes import fit
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.merge import TURN, Candidates, choose_size, heaviest, levels_of, side_of, turned
from pocketgs.prior.cloud.webgpu.layout import MERGED_WORDS
from pocketgs.prior.cloud.webgpu.passes import FILL, MERGE, describe_merging
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.device import MB, DeviceName


class WebGpuMerger:
    """See `pocketgs.prior.cloud.merge.Merger`. What the GPU's memory does not hold, the CPU merges.

    Voxels are those of the CPU, but for candidates within rounding of a side: positions are in single precision,
    relative to their median.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    name: DeviceName = "webgpu"

    def __init__(self, gpu: str | None = None, max_memory: int = 3000) -> None:
        self._adapter = choose_adapter(gpu)
        self.executor = Executor(shared_device(self._adapter), describe_merging())
        self._max_memory = max_memory * MB

    def merged(self, candidates: Candidates, count: int) -> PointCloud:
        """Average the candidates in each voxel. The GPU's memory is held only meanwhile."""
        total = len(candidates.positions)
        if total == 0 or not self._holds(total):
            return CpuMerger().merged(candidates, count)
        levels = levels_of(candidates)
        lowest, relative = levels.min(), levels - levels.min()
        along_grid = turned(candidates.positions)
        origin = np.median(along_grid, axis=0)
        local = along_grid - origin
        unit = float(np.abs(local).max()) or 1.0
        symbols = self._symbols(total, int(relative.max()) + 1, total)
        self._write(local / unit, relative, candidates, symbols)

        def filled(size: float) -> int:
            sides = side_of(lowest + np.arange(symbols["levels"]), size)
            within = np.modf(origin / sides[:, None])[0]
            grids = np.column_stack([within, unit / sides]).astype(np.float32)
            self.executor.write("grids", grids)
            self.executor.submit(FILL, symbols)
            return int(self.executor.read("places", np.uint32, 1, offset=total)[0])

        voxels = choose_size(filled, total, count)[1]
        self.executor.submit(MERGE, symbols)
        found = self.executor.read("merged", np.float32, MERGED_WORDS * voxels).reshape(-1, MERGED_WORDS)
        self.executor.release()
        weight, members = found[:, 9].astype(np.float64), found[:, 10]
        positions = (origin + unit * found[:, :3].astype(np.float64)) @ TURN
        directions = found[:, 6:9] / np.maximum(np.linalg.norm(found[:, 6:9], axis=1, keepdims=True), 1e-9)
        return heaviest(PointCloud(positions, found[:, 3:6], directions, weight / members), weight, count)

    def _holds(self, candidates: int) -> bool:
        sizes = self._sizes(self._symbols(candidates, 1, candidates))
        return fit(sizes, self._adapter.largest_buffer, self._max_memory)

    def _symbols(self, candidates: int, levels: int, voxels: int) -> dict[str, int]:
        given = {"candidates": candidates, "levels": levels, "voxels": voxels}
        return self.executor.description.symbols(given)

    def _sizes(self, symbols: dict[str, int]) -> dict[str, int]:
        return self.executor.description.sizes(symbols, self.executor.description.buffers)

    def _write(
        self, positions: np.ndarray, levels: np.ndarray, candidates: Candidates, symbols: dict[str, int]
    ) -> None:
        """Make the buffers, and write what does not depend on the voxels' size."""
        self.executor.reserve(self._sizes(symbols))
        attributes = np.column_stack([candidates.colours, candidates.directions, candidates.confidences])
        self.executor.write("positions", positions.astype(np.float32))
        self.executor.write("levels", levels.astype(np.uint32))
        self.executor.write("attributes", attributes.astype(np.float32))
        self.executor.write("candidate_count", np.array([len(positions)], np.uint32))
        self.executor.write_uniform("merging", {"candidates": len(positions)})
