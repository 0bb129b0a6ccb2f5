"""Detecting and matching features: the interface that the CPU and GPU versions implement."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.features.features import Features
from pocketgs.system.device import DeviceName


class FeatureFinder(Protocol):
    """Detects and matches features on one device. Several threads may use it at once.

    All devices find SIFT features as OpenCV does, in the image at twice its size.
    """

    name: DeviceName

    @property
    def most_pixels(self) -> int:
        """The largest image, in pixels, that the device's memory holds."""

    def detect(self, frame: Frame, most: int) -> Features:
        """Detect features in the pixels that mask and alpha leave.

        Args:
            frame: the photograph.
            most: maximum number of features, the strongest.
        """

    def match(self, first: Features, second: Features) -> np.ndarray:
        """Match features that are mutual nearest neighbours and pass the ratio test.

        Returns:
            (M, 2) int64 indices into `first` and `second`.
        """

    def release(self) -> None:
        """Give the device's memory back."""
