"""Loading frames: decode, composite, undistort, crop, downscale."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain, groupby, islice
from pathlib import Path
from typing import Literal

import numpy as np

from pocketgs.capture.capture import Frame, Result
from pocketgs.capture.decoding.image_file import UndecodableImageError, read_colour, read_header
from pocketgs.capture.decoding.video_file import VideoFrame, read_frames
from pocketgs.capture.frame_edits import cropped, downscaled, undistorted
from pocketgs.capture.frame_parts import camera_of_size, composite, depth_of_size, mask_of_size, refers_to_turned_pixels
from pocketgs.capture.listing import FrameSource
from pocketgs.capture.masks import OutsideMasks
from pocketgs.capture.undistortion import forget_undistortions
from pocketgs.errors import PocketGSError
from pocketgs.files.opening import reading_inside
from pocketgs.scene.background import BLACK, Background
from pocketgs.system.cores import usable_cores

MAX_READERS = 8
"""Maximum number of images that are read at the same time. Each takes a few full-size copies, and more readers are
little faster.
"""

LensHandling = Literal["undistort", "direct", "ignore"]


@dataclass(frozen=True)
class Preparation:
    """How images are prepared.

    Attributes:
        background: RGB in [0, 1] that images with alpha are composited on.
        lens: "undistort" makes pinhole images; "direct" leaves images as published and gives their cameras the lens;
            "ignore" leaves them as published and treats them as pinhole images.
        downscale: factor, at least 1, by which images are reduced.
        max_size: maximum of the longer side in pixels, or None.
        folder: that all files must lie in, see `reading_inside`; None for no restriction.
        masks: folder of masks that the user named, which may lie elsewhere, or None.
        outside_masks: "empty" to make alpha of masks too.
    """

    background: Background = BLACK
    lens: LensHandling = "undistort"
    downscale: float = 1.0
    max_size: int | None = None
    folder: Path | None = None
    masks: Path | None = None
    outside_masks: OutsideMasks = "unknown"


OnDamaged = Callable[[FrameSource, UndecodableImageError], None]
"""Called for a photograph that cannot be decoded, and is left out."""


def load_frames(
    sources: Sequence[FrameSource],
    preparation: Preparation,
    readers: int = MAX_READERS,
    on_damaged: OnDamaged | None = None,
) -> list[Frame]:
    """Load frames in parallel, in order. At most `readers` full-size images are in memory at any time.

    Args:
        sources: the frames as listed.
        preparation: how images are prepared.
        readers: maximum number of images to read at the same time.
        on_damaged: see `OnDamaged`; None to raise the error.

    Raises:
        PocketGSError: as `load_frame`, for the first frame that fails.
    """
    return map_frames(sources, preparation, lambda frame: frame, readers, on_damaged)


def map_frames(
    sources: Sequence[FrameSource],
    preparation: Preparation,
    look: Callable[[Frame], Result],
    readers: int = MAX_READERS,
    on_damaged: OnDamaged | None = None,
) -> list[Result]:
    """Apply `look` to every frame, in parallel, and return the results in order. Frames are not kept.

    Arguments as for `load_frames`.

    Raises:
        PocketGSError: as `load_frame`, for the first frame that fails.
    """
    found: list[Result] = []
    try:
        threads = min(MAX_READERS, usable_cores(), readers)
        with reading_inside(preparation.folder), ThreadPoolExecutor(threads) as pool:

            def load(source: FrameSource) -> list[Result]:
                with reading_inside(preparation.folder):  # the restriction is per thread
                    try:
                        decoded = _decoded(source)
                    except UndecodableImageError as error:
                        if on_damaged is None:
                            raise
                        on_damaged(source, error)
                        return []
                    return [look(prepared(source, *decoded, preparation))]

            for video, group in groupby(sources, key=_video_of):
                if video is None:
                    found.extend(chain.from_iterable(pool.map(load, group)))
                else:
                    found.extend(_map_video(video, list(group), preparation, look, pool))
        return found
    finally:
        forget_undistortions()


def _video_of(source: FrameSource) -> Path | None:
    return source.image.path if isinstance(source.image, VideoFrame) else None


def _map_video(
    video: Path,
    sources: list[FrameSource],
    preparation: Preparation,
    look: Callable[[Frame], Result],
    pool: ThreadPoolExecutor,
) -> Iterator[Result]:
    """Decode a video once, in order, and prepare a few frames at a time in parallel."""
    indices = [source.image.index for source in sources if isinstance(source.image, VideoFrame)]
    images = (image for _, image in read_frames(video, indices, upright=False))
    pairs = zip(sources, images, strict=True)

    def finish(pair: tuple[FrameSource, np.ndarray]) -> Result:
        with reading_inside(preparation.folder):
            return look(prepared(pair[0], pair[1], None, preparation))

    while batch := list(islice(pairs, MAX_READERS)):
        yield from pool.map(finish, batch)


def load_frame(source: FrameSource, preparation: Preparation) -> Frame:
    """Load one frame: decode and prepare its image, mask, depth and camera.

    Raises:
        PocketGSError: a file is missing or damaged, an image's shape differs from its camera's, or no pixel is left.
    """
    return prepared(source, *_decoded(source), preparation)


def _decoded(source: FrameSource) -> tuple[np.ndarray, np.ndarray | None]:
    """Colours and alpha of a frame's image, as `read_colour` returns them."""
    if isinstance(source.image, VideoFrame):
        [(_, image)] = read_frames(source.image.path, [source.image.index], upright=False)
        return image, None
    return read_colour(source.image, refers_to_turned_pixels(source, read_header(source.image)))


def prepared(source: FrameSource, colours: np.ndarray, alpha: np.ndarray | None, preparation: Preparation) -> Frame:
    """Prepare a decoded frame, with its mask and depth.

    Args:
        source: the frame as listed.
        colours: (H, W, 3) uint8 RGB.
        alpha: (H, W) uint8, or None.
        preparation: how images are prepared.

    Raises:
        PocketGSError: as `load_frame`.
    """
    height, width = colours.shape[:2]
    frame = Frame(
        name=source.name,
        camera=camera_of_size(source, width, height),
        image=colours if alpha is None else composite(colours, alpha, preparation.background),
        alpha=alpha,
        mask=mask_of_size(source, width, height, preparation.masks or preparation.folder),
        depth=None if source.depth_path is None else depth_of_size(source, width, height),
    )
    try:
        if preparation.lens == "undistort" and source.lens.distorts:
            frame = undistorted(frame, source.lens)
        elif preparation.lens == "direct":
            frame = replace(frame, camera=replace(frame.camera, lens=source.lens))
        if source.border:
            width, height = frame.camera.width - 2 * source.border, frame.camera.height - 2 * source.border
            frame = cropped(frame, source.border, source.border, width, height)
        frame = downscaled(frame, preparation.downscale, preparation.max_size)
    except PocketGSError as error:
        raise PocketGSError(f"{source.image}: {error}") from error
    return _cut_out(frame, preparation.background) if preparation.outside_masks == "empty" else frame


def _cut_out(frame: Frame, background: Background) -> Frame:
    """The frame with its mask as alpha too, on a background; the frame itself if it has no mask."""
    if frame.mask is None:
        return frame
    # Not composited: a mask is all or nothing, and that would take several times the memory.
    colour = np.rint(np.array(background) * 255).astype(np.uint8)
    opacity = np.uint8(255) if frame.alpha is None else frame.alpha
    image = np.where(frame.mask[..., None], frame.image, colour)
    return replace(frame, image=image, alpha=np.where(frame.mask, opacity, np.uint8(0)))
