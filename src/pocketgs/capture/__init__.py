"""Captures: readers for posed photographs in many formats."""

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.listed import ListedCapture
from pocketgs.capture.open import list_capture, open_capture
from pocketgs.capture.options import CaptureOptions

__all__ = ["Capture", "CaptureOptions", "Frame", "ListedCapture", "list_capture", "open_capture"]
