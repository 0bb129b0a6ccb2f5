"""A capture in memory: posed frames, split into training and held-out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import BLACK, Background, checked_background
from pocketgs.scene.point_cloud import PointCloud


@dataclass(frozen=True)
class Frame:
    """One photograph with its camera, which has a lens where the photograph is held as it was taken.

    Attributes:
        name: path of the image from the capture's folder, such as "images/0001.jpg". No two frames of a capture have
            the same.
        camera: camera of the image in memory (undistorted, cropped and resized).
        image: (H, W, 3) uint8 RGB; images with alpha are composited on the capture's background.
        alpha: (H, W) uint8 opacity of the file's pixels, or None.
        mask: (H, W) bool, True for pixels to use, or None for all.
        depth: (H, W) float32 depth along the optical axis in the capture's units, 0 where unknown, or None.

    Raises:
        PocketGSError: an array does not have the camera's size, or the stated type.
    """

    name: str
    camera: Camera
    image: np.ndarray
    alpha: np.ndarray | None = None
    mask: np.ndarray | None = None
    depth: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            raise PocketGSError(f"frame {self.name!r}: camera is {type(self.camera).__name__}, expected a Camera")
        size = (self.camera.height, self.camera.width)
        self._check("image", self.image, np.dtype(np.uint8), (*size, 3))
        self._check("alpha", self.alpha, np.dtype(np.uint8), size)
        self._check("mask", self.mask, np.dtype(np.bool_), size)
        self._check("depth", self.depth, np.dtype(np.float32), size)
        if self.depth is not None and not np.isfinite(self.depth).all():
            raise PocketGSError(f"frame {self.name!r}: depth holds NaN or infinity, expected 0 where it is unknown")

    def _check(self, what: str, array: np.ndarray | None, dtype: np.dtype, shape: tuple[int, ...]) -> None:
        """Check an array's type and shape: kernels would read out of bounds otherwise."""
        if array is None and what != "image":
            return
        if not isinstance(array, np.ndarray) or array.dtype != dtype or array.shape != shape:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            raise PocketGSError(
                f"frame {self.name!r}: {what} is {found}, expected {dtype} {shape} as its camera has it"
            )

    @property
    def visible(self) -> np.ndarray | None:
        """(H, W) bool: pixels with alpha above 0, which show more than the background, or None for all."""
        return None if self.alpha is None else self.alpha > 0

    @property
    def usable(self) -> np.ndarray | None:
        """(H, W) bool: pixels with alpha of one half or more that the mask does not exclude, or None for all."""
        parts = [part for part in (self.mask, None if self.alpha is None else self.alpha >= 128) if part is not None]
        return np.logical_and.reduce(parts) if parts else None


Result = TypeVar("Result")


class Photographs(Protocol):
    """A capture's photographs on disk, which can be decoded again at another size."""

    @property
    def longest_side(self) -> int:
        """Longest side of any stored photograph, in pixels."""

    def map(self, look: Callable[[Frame], Result], max_size: int) -> dict[str, Result]:
        """Apply `look` to every frame, decoded at most `max_size` pixels a side, and return the results by name.

        Only a few frames are in memory at a time. `look` is called from several threads.
        """


@dataclass(frozen=True)
class Capture:
    """A capture in memory, ready for training.

    Attributes:
        name: short name for reports.
        path: where it was read from.
        format: name of the reader.
        train: frames to train on, in capture order.
        held_out: frames kept for evaluation, in capture order.
        points: the capture's own point cloud, or None.
        background: RGB in [0, 1].
        metric: whether lengths are metres.
        origin: position of this coordinate origin in the world of the files, see `pocketgs.capture.origin`.
        protocol: text that says how images were prepared and split; reported with every figure.
        warnings: for the user, such as listed frames whose files are missing.
        photographs: the photographs on disk, or None if there are only the frames in memory.

    Raises:
        PocketGSError: the background is not a colour, or two frames have the same name: poses and masks are kept by it.
    """

    name: str
    path: Path
    format: str
    train: list[Frame]
    held_out: list[Frame]
    points: PointCloud | None = None
    background: Background = BLACK
    metric: bool = False
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    protocol: str = ""
    warnings: tuple[str, ...] = field(default=())
    photographs: Photographs | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        checked_background(self.background)
        names = Counter(frame.name for frame in self.frames)
        if repeated := [name for name, count in names.items() if count > 1]:
            found = f"{self.path}: {names[repeated[0]]} frames are named {repeated[0]!r}"
            raise PocketGSError(f"{found}, expected a name of its own for each")

    @property
    def frames(self) -> list[Frame]:
        """Training frames, then held-out frames."""
        return self.train + self.held_out

    def with_refined_poses(self, cameras: Mapping[str, Camera]) -> Capture:
        """The capture with new cameras for the named frames; the protocol is updated."""

        def posed(frames: list[Frame]) -> list[Frame]:
            return [replace(frame, camera=cameras.get(frame.name, frame.camera)) for frame in frames]

        protocol = f"{self.protocol}, poses refined"
        return replace(self, train=posed(self.train), held_out=posed(self.held_out), protocol=protocol)

    @property
    def image_bytes(self) -> int:
        """Memory of the frames' images, alphas, masks and depths, in bytes."""
        arrays = [a for f in self.frames for a in (f.image, f.alpha, f.mask, f.depth) if a is not None]
        return sum(array.nbytes for array in arrays)
