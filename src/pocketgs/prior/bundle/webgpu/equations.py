"""Normal equations on a GPU.

The GPU works in single precision, around the middle of the cameras and in units of the scene's size, which keeps
residuals to some 1e-4 pixels. The small system of the cameras is put together and solved in double precision on the
host, which also decides by the exact cost whether a step is taken.
"""

from __future__ import annotations

import numpy as np

from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.buffer_sizes import fit
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.prior.bundle.cpu.equations import CpuEquations
from pocketgs.prior.bundle.equations import CameraEquations, NormalEquations
from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, Estimate, Sightings
from pocketgs.prior.bundle.webgpu.layout import CAMERA_SUMS, COLUMNS, PAIR_SUMS, PRODUCTS
from pocketgs.prior.bundle.webgpu.passes import REDUCE, STEP, describe_equations
from pocketgs.prior.bundle.webgpu.problem import by_camera, meeting_count, meetings_of
from pocketgs.system.device import MB, DeviceName


class WebGpuLinearizer:
    """See `pocketgs.prior.bundle.equations.Linearizer`. What the GPU's memory does not hold, the CPU computes.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    name: DeviceName = "webgpu"

    def __init__(self, gpu: str | None = None, max_memory: int = 3000) -> None:
        self._adapter = choose_adapter(gpu)
        self._executor = Executor(shared_device(self._adapter), describe_equations())
        self._max_memory = max_memory * MB

    def equations(self, sightings: Sightings, huber: float) -> NormalEquations:
        """The equations of a problem."""
        meetings = meeting_count(sightings)
        counts = {
            "cameras": len(sightings.intrinsics),
            "points": len(sightings.starts) - 1,
            "observations": len(sightings.frame),
            "pairs": min(len(sightings.intrinsics) ** 2, meetings),
            "meetings": meetings,
        }
        description = self._executor.description
        if fit(description.sizes(counts, description.buffers), self._adapter.largest_buffer, self._max_memory):
            return WebGpuEquations(self._executor, sightings, huber)
        return CpuEquations(sightings, huber)

    def release(self) -> None:
        """Give the GPU's memory back."""
        self._executor.release()


class WebGpuEquations:
    """See `pocketgs.prior.bundle.equations.NormalEquations`.

    Args:
        executor: of `describe_equations`. It holds one problem at a time.
        sightings: the observations.
        huber: length in pixels above which the loss of a residual is linear.
    """

    _unit: float

    def __init__(self, executor: Executor, sightings: Sightings, huber: float) -> None:
        self._executor, self._sightings, self._huber = executor, sightings, huber
        meetings = meetings_of(sightings)
        self._pairs = meetings.pairs
        self._numbers = {
            "cameras": len(sightings.intrinsics),
            "points": len(sightings.starts) - 1,
            "observations": len(sightings.frame),
            "pairs": len(meetings.pairs),
            "meetings": len(meetings.observations),
        }
        executor.reserve(executor.description.sizes(self._numbers, executor.description.buffers))
        camera_starts, seen = by_camera(sightings)
        lists = {
            "starts": sightings.starts.astype(np.uint32),
            "frames": sightings.frame.astype(np.uint32),
            "pixels": (sightings.pixels - sightings.intrinsics[sightings.frame, 2:]).astype(np.float32),
            "camera_starts": camera_starts,
            "seen": seen,
            "pair_starts": meetings.starts,
            "meetings": meetings.observations,
        }
        for name, values in lists.items():
            executor.write(name, values)

    def reduced(self, estimate: Estimate, damping: float) -> CameraEquations:
        """The equations for the cameras' step."""
        # Not the mean: a camera that ran away would move it so far that the others lose their digits.
        middle = np.median(estimate.centres, axis=0)
        points, centres = estimate.points - middle, estimate.centres - middle
        self._unit = float(np.median(np.abs(points).max(axis=1))) or 1.0
        focal, rotations = self._sightings.intrinsics[:, :2], estimate.rotations.reshape(-1, 9)
        cameras = np.hstack([rotations, centres / self._unit, focal]).astype(np.float32)
        self._executor.write("cameras", cameras)
        self._executor.write("positions", (points / self._unit).astype(np.float32))
        counts = {name: self._numbers[name] for name in ("cameras", "points", "pairs")}
        self._executor.write_uniform("adjustment", {**counts, "huber": self._huber, "damping": damping})
        self._executor.submit(REDUCE, self._numbers)
        return self._assembled()

    def point_steps(self, camera_step: np.ndarray) -> tuple[np.ndarray, float]:
        """Steps of the points, and their part of the expected decrease."""
        self._executor.write("camera_step", (camera_step / self._units()).astype(np.float32))
        self._executor.submit(STEP, self._numbers)
        found = self._executor.read("point_steps", np.float32, 4 * self._numbers["points"]).reshape(-1, 4)
        steps = found.astype(np.float64)
        return self._unit * steps[:, :3], float(steps[:, 3].sum())

    def _assembled(self) -> CameraEquations:
        """Put the equations together from the sums of cameras and of pairs."""
        count = self._numbers["cameras"]
        products, taken = np.split(self._read("camera_sums", CAMERA_SUMS, count), [PRODUCTS], axis=1)
        products = products.reshape(count, CAMERA_UNKNOWNS, COLUMNS)
        blocks, gradient = products[:, :, :CAMERA_UNKNOWNS], -products[:, :, CAMERA_UNKNOWNS].ravel()
        pairs = self._read("pair_sums", PAIR_SUMS, self._numbers["pairs"])
        matrix, each = np.zeros((CAMERA_UNKNOWNS * count,) * 2), np.arange(count)
        tiles = matrix.reshape(count, CAMERA_UNKNOWNS, count, CAMERA_UNKNOWNS)
        tiles[each, :, each] = blocks
        tiles[self._pairs[:, 0], :, self._pairs[:, 1]] -= pairs.reshape(-1, CAMERA_UNKNOWNS, CAMERA_UNKNOWNS)
        diagonal, right = np.einsum("faa->fa", blocks).ravel(), gradient - taken.ravel()
        units = self._units()
        for row, unit in zip(matrix, units, strict=True):
            row /= unit * units  # in place: the matrix of many cameras is large
        return CameraEquations(matrix, right / units, diagonal / units**2, gradient / units)

    def _read(self, name: str, words: int, rows: int) -> np.ndarray:
        return self._executor.read(name, np.float32, words * rows).reshape(rows, words).astype(np.float64)

    def _units(self) -> np.ndarray:
        """(D,) length of each unknown's unit on the GPU."""
        return np.tile(np.repeat([1.0, self._unit], 3), self._numbers["cameras"])
