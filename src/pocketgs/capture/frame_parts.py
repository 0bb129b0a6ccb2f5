"""The parts of a frame at the size of its image file: camera, mask and depth, and colours on a background."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.capture.decoding.depth_file import read_depth, read_reliable
from pocketgs.capture.decoding.image_file import ImageHeader, read_header
from pocketgs.capture.decoding.mask_file import read_mask
from pocketgs.capture.decoding.video_file import VideoFrame
from pocketgs.capture.frame_edits import nearest
from pocketgs.capture.listing import FrameSource
from pocketgs.errors import PocketGSError
from pocketgs.files.opening import CaptureFile, reading_inside
from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import Background

ASPECT_TOLERANCE = 0.01
PLANE_ASPECT_TOLERANCE = 0.02  # masks and depth are often computed on small images, where rounding is visible


def depth_of_size(source: FrameSource, width: int, height: int) -> np.ndarray | None:
    """(height, width) float32 depth of a frame; None if it cannot be read or has another shape.

    It may be a coloured picture of depth, of another part of the view, or turned. A photograph alone is enough.
    """
    try:
        depth = reliable_depth(source)
    except PocketGSError:
        return None
    fits = _have_same_shape(depth.shape[::-1], (width, height), PLANE_ASPECT_TOLERANCE)
    return nearest(depth, width, height) if fits else None


def reliable_depth(source: FrameSource) -> np.ndarray:
    """(H, W) float32 depth of a frame at its stored size; 0 where unknown or unreliable.

    Raises:
        PocketGSError: a file is missing or damaged, or depth and confidence differ in size.
    """
    assert source.depth_path is not None
    depth = read_depth(source.depth_path, source.depth_unit, source.depth_shape)
    if source.confidence_path is None:
        return depth
    reliable = read_reliable(source.confidence_path, source.depth_shape)
    if reliable.shape != depth.shape:
        sizes = ["{1}x{0}".format(*array.shape) for array in (reliable, depth)]
        raise PocketGSError(f"{source.confidence_path}: {sizes[0]} pixels, expected the depth map's {sizes[1]}")
    return np.where(reliable, depth, np.float32(0))


def header_of(source: FrameSource) -> ImageHeader:
    """The header of a frame's image, turned if its camera refers to the turned photograph.

    Raises:
        PocketGSError: the file is missing or not an image.
    """
    if isinstance(source.image, VideoFrame):
        return ImageHeader(source.camera.width, source.camera.height, has_alpha=False)
    header = read_header(source.image)
    if refers_to_turned_pixels(source, header):
        return ImageHeader(*header.upright_size, header.has_alpha)
    return header


def refers_to_turned_pixels(source: FrameSource, header: ImageHeader) -> bool:
    """Whether a frame's camera refers to the photograph after EXIF's orientation is applied.

    Poses usually refer to stored pixels, since most programs ignore EXIF. Some do not: then the camera's width and
    height fit only the rotated photograph.
    """
    stated = (source.camera.width, source.camera.height)
    fits_stored = _have_same_shape((header.width, header.height), stated, ASPECT_TOLERANCE)
    return not fits_stored and _have_same_shape(header.upright_size, stated, ASPECT_TOLERANCE)


def _have_same_shape(one: tuple[int, ...], other: tuple[int, ...], tolerance: float) -> bool:
    """Whether two sizes (width, height) have about the same aspect ratio."""
    return abs((one[0] / other[0]) / (one[1] / other[1]) - 1) <= tolerance


def mask_of_size(source: FrameSource, width: int, height: int, folder: Path | None) -> np.ndarray | None:
    """(height, width) bool mask of a frame; None if it has none, or one that was found and cannot be used.

    Args:
        source: the frame as listed.
        width: of its photograph.
        height: likewise.
        folder: that the mask must lie in; None for no restriction.

    Raises:
        PocketGSError: a mask that was named cannot be used.
    """
    if source.mask_path is None:
        return None
    try:
        return _resized_mask(source.mask_path, width, height, folder)
    except PocketGSError:
        if source.mask_is_found:
            return None
        raise


def _resized_mask(path: CaptureFile, width: int, height: int, folder: Path | None) -> np.ndarray:
    """Read a mask and resize it to its photograph's size.

    Raises:
        PocketGSError: its shape differs.
    """
    with reading_inside(folder):
        mask = read_mask(path)
    rows, columns = mask.shape
    if not _have_same_shape((columns, rows), (width, height), PLANE_ASPECT_TOLERANCE):
        raise PocketGSError(
            f"{path}: mask of {columns}x{rows} pixels, expected the shape of its photograph, {width}x{height}"
        )
    return nearest(mask, width, height)


def camera_of_size(source: FrameSource, width: int, height: int) -> Camera:
    """The frame's camera, scaled to the size of its image file.

    Raises:
        PocketGSError: the aspect ratios differ by more than 1 %.
    """
    camera = source.camera
    if not _have_same_shape((width, height), (camera.width, camera.height), ASPECT_TOLERANCE):
        raise PocketGSError(
            f"{source.image}: image of {width}x{height} pixels, expected the shape of its camera, "
            f"{camera.width}x{camera.height}"
        )
    return camera if (width, height) == (camera.width, camera.height) else camera.resized(width, height)


def composite(colours: np.ndarray, alpha: np.ndarray, background: Background) -> np.ndarray:
    """Composite colours on a background.

    Args:
        colours: (H, W, 3) uint8, not premultiplied.
        alpha: (H, W) uint8.
        background: RGB in [0, 1].

    Returns:
        (H, W, 3) uint8.
    """
    behind = np.array(background, dtype=np.float32) * 255
    blend = colours - behind
    blend *= alpha[:, :, None] * np.float32(1 / 255)
    blend += behind + np.float32(0.5)
    return blend.astype(np.uint8)
