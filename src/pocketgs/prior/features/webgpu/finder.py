"""Features on a GPU."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.gpu.sizes import Symbols
from pocketgs.prior.features.features import DESCRIPTOR, Features, Nearest, mutual_matches, unmasked
from pocketgs.prior.features.webgpu.layout import (
    FEATURE,
    FEATURES,
    NEAREST,
    OCTAVE_BYTES,
    OTHER_BYTES,
    PIXEL_BYTES,
    kernels,
)
from pocketgs.prior.features.webgpu.passes import DESCRIBE, FIND, MATCH, describe_features, describe_matching
from pocketgs.system.device import MB, DeviceName


class WebGpuFinder:
    """See `pocketgs.prior.features.finder.FeatureFinder`. The GPU's memory is taken at the first image.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    name: DeviceName = "webgpu"

    def __init__(self, gpu: str | None = None, max_memory: int = 3000) -> None:
        adapter = choose_adapter(gpu)
        device = shared_device(adapter)
        self.finding, self.matching = Executor(device, describe_features()), Executor(device, describe_matching())
        self.most_pixels = min(
            adapter.largest_buffer // OCTAVE_BYTES, max(0, max_memory * MB - OTHER_BYTES) // PIXEL_BYTES
        )
        self._lock = threading.Lock()

    def detect(self, frame: Frame, most: int) -> Features:
        """Detect features."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        height, width = grey.shape
        with self._lock:
            given = {"width": width, "height": height, "chosen": most}
            found = _strongest(self._find(grey, given), most)
            pixels = _pixels_of(found)
            inside = unmasked(frame, pixels)
            found, pixels = found[inside], pixels[inside]
            return Features(pixels, self._describe(found, {**given, "chosen": len(found)}))

    def match(self, first: Features, second: Features) -> np.ndarray:
        """Match features."""
        counts = {"first": len(first.pixels), "second": len(second.pixels)}
        if min(counts.values()) < 2:
            return np.zeros((0, 2), np.int64)
        with self._lock:
            executor = self.matching
            executor.grow(executor.description.sizes(counts, executor.description.buffers))
            executor.write("first_descriptors", first.descriptors)
            executor.write("second_descriptors", second.descriptors)
            executor.write_uniform("sizes", {"rows": counts["first"], "columns": counts["second"]})
            executor.submit(MATCH, counts)
            forwards, backwards = (
                executor.read(name, np.uint32, NEAREST.itemsize // 4 * count).view(NEAREST)
                for name, count in zip(("forwards", "backwards"), counts.values(), strict=True)
            )
        number = forwards["number"].astype(np.int64)
        return mutual_matches(
            Nearest(number, forwards["product"], forwards["next_product"]), backwards["number"].astype(np.int64)
        )

    def release(self) -> None:
        """Give up all buffers."""
        with self._lock:
            self.finding.release()
            self.matching.release()

    def _find(self, grey: np.ndarray, given: Symbols) -> np.ndarray:
        """All features of a photograph, as `FEATURE` records in no particular order."""
        executor = self.finding
        symbols = executor.description.symbols(given)
        executor.grow(executor.description.sizes(symbols, executor.description.buffers))
        executor.write("grey", grey)
        executor.write("kernels", np.concatenate(kernels()).astype(np.float32))
        self._submit_by_octave(FIND, symbols)
        count = min(int(executor.read("counts", np.uint32, 2)[FEATURES]), symbols["feature_room"])
        return executor.read("features", np.uint32, FEATURE.itemsize // 4 * count).view(FEATURE)

    def _describe(self, found: np.ndarray, given: Symbols) -> np.ndarray:
        """(N, 128) float32 descriptors of features of the photograph whose scale space is there."""
        executor = self.finding
        if not len(found):
            return np.zeros((0, DESCRIPTOR), np.float32)
        symbols = executor.description.symbols(given)
        executor.write("features", found.view(np.uint32))
        self._submit_by_octave(DESCRIBE, symbols)
        return executor.read("descriptors", np.float32, DESCRIPTOR * len(found)).reshape(-1, DESCRIPTOR)

    def _submit_by_octave(self, sequences: Sequence[str], symbols: Symbols) -> None:
        """Run an octave's sequence for each octave that the photograph has."""
        fields = self.finding.description.uniforms["image"].fields
        for octave, name in enumerate(sequences[: symbols["octaves"]]):
            values = {**symbols, "octave": octave}
            self.finding.write_uniform("image", {field: values[field] for field in fields})
            self.finding.submit(name, symbols)


def _strongest(found: np.ndarray, most: int) -> np.ndarray:
    """At most so many different features, the strongest, in an order that does not depend on the GPU's."""
    x, y = found["place"].T
    order = np.lexsort((found["angle"], x, y, found["layer"], found["octave"], -found["response"]))
    found = found[order]
    same = found[1:] == found[:-1]
    return found[np.append(True, ~same)[: len(found)]][:most]


def _pixels_of(found: np.ndarray) -> np.ndarray:
    """(N, 2) float64 positions in the photograph; the centre of the top left pixel is (0.5, 0.5)."""
    return found["place"].astype(np.float64) * 2.0 ** (found["octave"][:, None] - 1.0) + 0.5
