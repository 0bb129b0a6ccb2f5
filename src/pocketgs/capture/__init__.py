"""Captures: reading posed photographs in the formats that other programs write."""

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.open import open_capture

__all__ = ["Capture", "Frame", "open_capture"]
