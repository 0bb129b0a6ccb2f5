"""Feature detection in all frames of a capture, on photographs as large as the time budget allows."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numba
import numpy as np

from pocketgs.capture.capture import Frame, Photographs
from pocketgs.capture.frame_edits import downscaled
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.finder import FeatureFinder

MAX_SIDE = 1280
"""Larger images do not give better features: phones blur by more than a pixel."""

PIXELS = 160e6
"""Maximum total number of pixels for detection: some 20 s on two cores."""

FEATURES = 2_000_000
"""Maximum total number of features: descriptors take 1 GB, and matches and tracks nearly as much again. With more than
a thousand frames, each has fewer."""

MAX_AT_ONCE = 4
"""Maximum number of images in memory in which features are found at the same time. It bounds memory on machines with
many cores, which are used all the same: OpenCV has threads of its own for each image."""

WORTHWHILE = 1.1
"""Minimum factor in size for which photographs are decoded again."""


def detect_all(
    frames: Sequence[Frame], most: int, finder: FeatureFinder, photographs: Photographs | None = None
) -> list[Features]:
    """Detect features in every frame, in parallel, in the frame's own pixel coordinates.

    Args:
        frames: as for training; all have a pinhole camera.
        most: maximum number of features per frame, the strongest; fewer if there are many frames.
        finder: detects them.
        photographs: the frames' photographs, possibly larger, or None to use the frames themselves.
    """
    if not frames:
        return []
    most = min(most, max(1, FEATURES // len(frames)))
    side = detection_side([(frame.camera.width, frame.camera.height) for frame in frames], finder.most_pixels)
    held = max(max(frame.camera.width, frame.camera.height) for frame in frames)
    if photographs is not None and min(side, photographs.longest_side) > WORTHWHILE * held:
        own = {frame.name: frame for frame in frames}

        def look(photograph: Frame) -> Features | None:
            frame = own.get(photograph.name)
            return None if frame is None else _seen_in(frame, photograph.camera, finder.detect(photograph, most))

        found = photographs.map(look, side)
        if all(found.get(frame.name) is not None for frame in frames):
            return [features for frame in frames if (features := found[frame.name]) is not None]
    with ThreadPoolExecutor(min(numba.get_num_threads(), MAX_AT_ONCE)) as pool:
        return list(pool.map(partial(_detect_in_memory, most=most, finder=finder, side=side), frames))


def detection_side(sizes: Sequence[tuple[int, int]], most_pixels: float = np.inf) -> int:
    """Longer side of the images to use, so that all of them together have `PIXELS`, and none more than the maximum.

    Args:
        sizes: width and height of each frame.
        most_pixels: maximum number of pixels of an image, see `FeatureFinder`.
    """
    shapes = [max(size) / min(size) for size in sizes]
    # The squarest image has most pixels for its longer side.
    return int(min(MAX_SIDE, np.sqrt(PIXELS / len(sizes) * np.median(shapes)), np.sqrt(most_pixels * min(shapes))))


def _detect_in_memory(frame: Frame, most: int, finder: FeatureFinder, side: int) -> Features:
    # The depth map is not needed, and takes time to resize.
    small = downscaled(Frame(frame.name, frame.camera, frame.image, frame.alpha, frame.mask), 1.0, side)
    return _seen_in(frame, small.camera, finder.detect(small, most))


def _seen_in(frame: Frame, camera: Camera, features: Features) -> Features:
    """Transfer features from another pinhole image of the same pose to the frame."""
    if camera.intrinsic_matrix.tolist() == frame.camera.intrinsic_matrix.tolist():
        return features
    scale = np.array([frame.camera.fx / camera.fx, frame.camera.fy / camera.fy])
    pixels = (features.pixels - (camera.cx, camera.cy)) * scale + (frame.camera.cx, frame.camera.cy)
    moved = Features(pixels, features.descriptors, float(np.sqrt(scale.prod())))
    return moved.select(frame.camera.contains(pixels))
