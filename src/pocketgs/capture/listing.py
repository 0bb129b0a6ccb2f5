"""The result of a reader: files, lenses and poses as the capture states them. No image is decoded yet."""

from __future__ import annotations

from dataclasses import dataclass, field

from pocketgs.capture.decoding.video_file import VideoFrame
from pocketgs.files.opening import CaptureFile
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import PINHOLE, Lens
from pocketgs.scene.background import BLACK, Background
from pocketgs.scene.point_cloud import PointCloud


@dataclass(frozen=True)
class FrameSource:
    """One frame as its capture lists it.

    Attributes:
        name: path of the image from the capture's folder.
        image: image file, or frame of a video. Frames of one video are adjacent and in ascending order.
        camera: intrinsics in pixels of an image of `camera.width` x `camera.height`, and the pose. The file may hold
            the image at another size of the same shape; the intrinsics are then scaled. Both refer to pixels as stored,
            before EXIF's orientation is applied.
        lens: distortion of the image.
        mask_path: image whose non-zero pixels are used, or None.
        mask_is_found: whether nobody named the mask, neither the user nor the capture: if it cannot be used, the frame
            is used whole.
        depth_path: depth map, or None.
        depth_unit: length of one unit of the depth map in the capture's units.
        depth_shape: rows and columns of a compressed depth map and its confidence, whose files do not state them.
        confidence_path: ARKit's confidence of each depth, or None; depths of low confidence are dropped.
        border: pixels to crop at each side of the image.
    """

    name: str
    image: CaptureFile | VideoFrame
    camera: Camera
    lens: Lens = PINHOLE
    mask_path: CaptureFile | None = None
    mask_is_found: bool = False
    depth_path: CaptureFile | None = None
    depth_unit: float = 0.001
    depth_shape: tuple[int, int] | None = None
    confidence_path: CaptureFile | None = None
    border: int = 0


@dataclass(frozen=True)
class Listing:
    """A capture as its reader found it.

    Attributes:
        format: name of the reader.
        frames: in capture order, with unique names.
        held_out: names of the test frames of the data set's own split, or None if it has no split.
        points: the capture's own cloud, or None.
        background: default colour that images with alpha are composited on.
        metric: whether lengths are metres.
        origin: position of this coordinate origin in the world of the files, see `pocketgs.capture.origin`.
        warnings: for the user.
    """

    format: str
    frames: list[FrameSource]
    held_out: frozenset[str] | None = None
    points: PointCloud | None = None
    background: Background = BLACK
    metric: bool = False
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    warnings: tuple[str, ...] = field(default=())
