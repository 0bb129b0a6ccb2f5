"""What a reader returns: files, lenses and poses as the capture states them, before any image is decoded."""

from __future__ import annotations

from dataclasses import dataclass, field

from pocketgs.capture.video_file import VideoFrame
from pocketgs.files.paths import CaptureFile
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import PINHOLE, Lens
from pocketgs.scene.point_cloud import PointCloud


@dataclass(frozen=True)
class FrameSource:
    """One frame as its capture lists it.

    Attributes:
        name: the image's name inside the capture.
        image: file to decode, or frame of a video. Frames of one video stand together, their numbers ascending.
        camera: intrinsics in pixels of an image of `camera.width` x `camera.height`, and the pose. The file may hold
            the image at another size of the same shape; the intrinsics then scale with it. Both refer to pixels as
            stored, before any turn that the file asks for.
        lens: distortion that the image shows.
        mask_path: image whose non-zero pixels are to be used, or None.
        depth_path: depth map, or None.
        depth_unit: length in the capture's units of one unit of the depth map.
        depth_shape: rows and columns of a compressed depth map and its confidence, which do not state them.
        confidence_path: ARKit's confidence in each depth, or None; depths of low confidence are dropped.
        border: pixels to cut off at each side of the image.
    """

    name: str
    image: CaptureFile | VideoFrame
    camera: Camera
    lens: Lens = PINHOLE
    mask_path: CaptureFile | None = None
    depth_path: CaptureFile | None = None
    depth_unit: float = 0.001
    depth_shape: tuple[int, int] | None = None
    confidence_path: CaptureFile | None = None
    border: int = 0


@dataclass(frozen=True)
class Listing:
    """A capture as its reader found it.

    Attributes:
        format: the reader's name for the format.
        frames: in capture order, names unique.
        held_out: names of the frames that the data set itself sets apart for testing, or None if it has no split.
        points: the capture's own cloud, or None.
        background: what to composite images with alpha on when the caller names nothing else.
        metric: whether lengths are metres.
        origin: where the origin of these coordinates lies in the world of the files, see `pocketgs.capture.origin`.
        warnings: what the user should know.
    """

    format: str
    frames: list[FrameSource]
    held_out: frozenset[str] | None = None
    points: PointCloud | None = None
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    metric: bool = False
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    warnings: tuple[str, ...] = field(default=())
