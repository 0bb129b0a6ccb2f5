"""Captures: readers for posed photographs in many formats."""

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.listed import ListedCapture
from pocketgs.capture.open import list_capture, open_capture

__all__ = ["Capture", "Frame", "ListedCapture", "list_capture", "open_capture"]
