"""The GPU's state of one image: drawing it, and sequences that work from what drawing has left."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.buffer_sizes import check_buffers
from pocketgs.gpu.description import Description
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.gpu.sizes import Symbols
from pocketgs.splat.webgpu.drawing import make_room_for, write_camera
from pocketgs.splat.webgpu.memory import GROWTH, MIN_INTERSECTIONS
from pocketgs.splat.webgpu.variant import Variant


class ImageLists:
    """Holds the tiles' lists of one image at a time.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        describe: gives the passes, with or without subgroups. The sequence "forward" draws an image.

    Raises:
        PocketGSError: there is no such device, or it lacks something.

    Attributes:
        lock: to hold from `holds` or `draw` until all is read: another thread's image would take this one's place.
    """

    def __init__(self, gpu: str | None, describe: Callable[[bool], Description]) -> None:
        adapter = choose_adapter(gpu)
        variant = Variant(subgroups="subgroup" in adapter.features)
        self._executor = Executor(shared_device(adapter, variant.features), describe(variant.subgroups))
        self._largest = adapter.largest_buffer
        self._room = MIN_INTERSECTIONS
        self._drawn: object | None = None
        self.symbols: dict[str, int] = {}
        self.lock = threading.Lock()

    def holds(self, image: object) -> bool:
        """Whether this image was drawn last."""
        return image is self._drawn

    def draw(
        self, image: object, given: Symbols, camera: Camera, near: float, content: Mapping[str, np.ndarray]
    ) -> None:
        """Draw an image over black.

        Args:
            image: identifies the image, for `holds`.
            given: numbers that `Description.symbols` needs, without "intersections".
            camera: the view to draw.
            near: minimum depth of drawn Gaussians.
            content: to write to buffers before drawing, by their names.
        """
        self._drawn = None
        wanted, least = self._room, MIN_INTERSECTIONS
        while True:
            make_room_for(partial(self._make_room, given), wanted, least)
            write_camera(self._executor, camera, (0.0, 0.0, 0.0), near, self.symbols)
            self._submit("forward", {**content, "status": np.zeros(3, np.uint32)})
            _, halted, needed = self.read("status", np.uint32, 3)
            if not halted:
                self._drawn = image
                # What follows holds something for each intersection that there is.
                self.symbols["intersections"] = int(needed)
                return
            wanted, least = int(needed * GROWTH), int(needed)

    def run(self, sequence: str, content: Mapping[str, np.ndarray] = MappingProxyType({})) -> None:
        """Run another sequence on the image that was drawn last."""
        self._reserve(sequence)
        self._submit(sequence, content)

    def read(self, name: str, dtype: type[np.generic], count: int) -> np.ndarray:
        """The first numbers of a buffer."""
        return self._executor.read(name, dtype, count)

    def _make_room(self, given: Symbols, intersections: int) -> None:
        """Make the buffers to draw an image with so many intersections."""
        self.symbols = self._executor.description.symbols({**given, "intersections": intersections})
        self._reserve("forward")
        self._room = intersections

    def _submit(self, sequence: str, content: Mapping[str, np.ndarray]) -> None:
        """Write to some buffers, then run a sequence."""
        for name, values in content.items():
            self._executor.write(name, values)
        self._executor.submit(sequence, self.symbols)

    def _reserve(self, sequence: str) -> None:
        """Make the buffers of a sequence, but for those that stand from the forward pass.

        Raises:
            PocketGSError: the device does not allow one as large.
        """
        description = self._executor.description
        standing = set() if sequence == "forward" else set(description.buffers_of(["forward"]))
        names = [name for name in description.buffers_of([sequence]) if name not in standing]
        sizes = description.sizes(self.symbols, names)
        check_buffers(sizes, self._largest, "fewer Gaussians, channels or pixels")
        self._executor.reserve(sizes)
