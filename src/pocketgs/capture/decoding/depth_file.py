"""Readers of depth maps and their confidences."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from pocketgs.capture.decoding.image_file import read_array, read_numbers
from pocketgs.capture.decoding.lzfse import read_compressed
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import CaptureFile, checked

MAX_SIDE = 16_384


def read_depth(path: CaptureFile, unit: float, shape: tuple[int, int] | None = None) -> np.ndarray:
    """Read a depth map as (H, W) float32 times `unit`; 0 where unknown.

    Args:
        path: a greyscale image of integers or floating-point numbers, an OpenEXR file or a .npy array; or, if `shape`
            is given, float32 numbers compressed with LZFSE.
        unit: length of one unit of the file.
        shape: rows and columns of a compressed map, whose file does not state them.

    Raises:
        PocketGSError: the file is missing, damaged, or of another type.
    """
    if shape is not None:
        raw = _decompressed(path, shape, np.dtype("<f4"))
    elif isinstance(path, Path) and path.suffix.lower() == ".npy":
        raw = read_array(path)
    elif isinstance(path, Path) and path.suffix.lower() == ".exr":
        raw = _only_channel(path)
    else:
        raw = read_numbers(path)
    if raw.ndim == 3 and raw.shape[2] == 1:
        raw = raw[:, :, 0]
    if raw.ndim != 2 or raw.dtype.kind not in "uif":
        raise PocketGSError(f"{path}: depth of shape {raw.shape}, type {raw.dtype}, expected (H, W) numbers")
    depth = raw.astype(np.float32) * np.float32(unit)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def read_reliable(path: CaptureFile, shape: tuple[int, int] | None = None) -> np.ndarray:
    """Read a confidence map as (H, W) bool, True where ARKit's confidence is medium or high.

    Apps store the three levels as 0, 1, 2 or spread up to 255; low is always 0.

    Args:
        path: an 8-bit image; or, if `shape` is given, bytes compressed with LZFSE.
        shape: rows and columns of a compressed map.

    Raises:
        PocketGSError: as `read_depth`.
    """
    raw = read_numbers(path) if shape is None else _decompressed(path, shape, np.dtype(np.uint8))
    return raw > 0


def _only_channel(path: Path) -> np.ndarray:
    """Read the depth of an OpenEXR file as (H, W) float: channel Z, or else the first that is not alpha.

    Raises:
        PocketGSError: the file is missing, damaged or far too large.
    """
    if not path.is_file():
        raise PocketGSError(f"{path}: no such file, expected a depth map")
    openexr = importlib.import_module("OpenEXR")  # loaded only when needed
    try:
        parts = openexr.File(str(checked(path)), header_only=True)
        header = parts.header()
        first, last = header["dataWindow"]
        if max(last - first) >= MAX_SIDE:
            raise ValueError(f"{last - first + 1} pixels, expected at most {MAX_SIDE} a side")
        count, (columns, rows) = len(header["channels"]), last - first + 1
        require_memory(path, 2 * 4 * count * rows * columns, f"{count} channels of {columns}x{rows} pixels")
        channels = openexr.File(str(path), separate_channels=True).channels()
        return np.array(channels[min(channels, key=_likelihood)].pixels)
    except PocketGSError:
        raise
    except Exception as error:  # the library raises several types
        raise PocketGSError(f"{path}: not a readable OpenEXR file ({error})") from error


def _likelihood(channel: str) -> tuple[bool, bool, str]:
    """Sort key of a channel: depth first, alpha last. Its name may begin with its layer's (`ViewLayer.Depth.Z`)."""
    name = channel.rpartition(".")[2]
    return name != "Z", name == "A", channel


def _decompressed(path: CaptureFile, shape: tuple[int, int], kind: np.dtype) -> np.ndarray:
    content = read_compressed(path)
    rows, columns = shape
    expected = rows * columns * kind.itemsize
    if len(content) != expected:
        raise PocketGSError(f"{path}: holds {len(content)} bytes, expected {expected} for {columns}x{rows} pixels")
    return np.frombuffer(content, dtype=kind).reshape(shape)
