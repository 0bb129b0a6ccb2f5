"""Nearest neighbours on a GPU."""

from __future__ import annotations

import numpy as np

from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.scene.morton import morton_order
from pocketgs.seeding.neighbourhoods import Neighbourhoods
from pocketgs.seeding.webgpu.layout import LARGEST_BYTES, POINT_BYTES, numbers_of
from pocketgs.seeding.webgpu.passes import LOOK_AROUND, describe_neighbourhoods
from pocketgs.system.device import MB, DeviceName


class WebGpuSearch:
    """See `pocketgs.seeding.neighbourhoods.NeighbourSearch`. It holds the GPU's memory only while it searches.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    name: DeviceName = "webgpu"

    def __init__(self, gpu: str | None = None, max_memory: int = 3000) -> None:
        adapter = choose_adapter(gpu)
        self.executor = Executor(shared_device(adapter), describe_neighbourhoods())
        self.most_points = min(adapter.largest_buffer // LARGEST_BYTES, max_memory * MB // POINT_BYTES)

    def around(self, positions: np.ndarray) -> Neighbourhoods:
        """The neighbourhood of every point."""
        order = morton_order(positions)
        unit = self.submit(positions[order])
        spacing, normals, tangents = (np.empty((len(positions), columns)) for columns in (1, 3, 3))
        for name, found in (("spacing", spacing), ("normals", normals), ("tangents", tangents)):
            found[order] = self.executor.read(name, np.float32, found.size).reshape(found.shape)
        self.executor.release()
        return Neighbourhoods(unit * spacing[:, 0], normals, tangents)

    def submit(self, positions: np.ndarray) -> float:
        """Run the passes without waiting for them.

        Args:
            positions: as those of `around`, but along a Morton curve: else the boxes would be as large as the cloud.

        Returns:
            The unit of length of the GPU's positions and distances.
        """
        # Single precision is best around 0, where most points should be; and no square of a distance may vanish.
        centred = positions - np.median(positions, axis=0)
        unit = float(np.abs(centred).max()) or 1.0
        numbers = numbers_of(len(positions))
        self.executor.reserve(self.executor.description.sizes(numbers, self.executor.description.buffers))
        self.executor.write("positions", (centred / unit).astype(np.float32))
        self.executor.write_uniform("cloud", numbers)
        self.executor.submit(LOOK_AROUND, numbers)
        return unit
