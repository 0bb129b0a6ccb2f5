"""A capture known from its photographs' headers, not yet decoded. Runs are planned from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.decoding.image_file import ImageHeader, UndecodableImageError
from pocketgs.capture.frame_edits import size_after
from pocketgs.capture.frame_parts import camera_of_size, header_of
from pocketgs.capture.left_out import damaged_warning, depth_warnings, mask_warnings, masked_out_warning
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.loading import MAX_READERS, Preparation, load_frames
from pocketgs.capture.outline import Outline, Size
from pocketgs.capture.plain_background import plain_background
from pocketgs.capture.stored_photographs import StoredPhotographs
from pocketgs.capture.undistortion import inner_rectangle
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import fits, require_memory, room_for
from pocketgs.files.opening import reading_inside
from pocketgs.scene.background import BLACK, Background

RGB_BYTES = 3


@dataclass(frozen=True)
class ListedCapture:
    """A capture that is listed and split, ready to be decoded.

    Attributes:
        name, path: as in `Capture`.
        listing: its frames.
        held_out_names: names of the held-out frames.
        split: how they were chosen, as text.
        preparation: applied to every image.
        size_is_given: whether the user chose the image size.
        background_is_given: whether the user chose the background.
    """

    name: str
    path: Path
    listing: Listing
    held_out_names: frozenset[str]
    split: str
    preparation: Preparation
    size_is_given: bool = False
    background_is_given: bool = False

    def outline(self, shrink: int = 1) -> Outline:
        """Image sizes, from the photographs' headers.

        Args:
            shrink: integer factor by which photographs are reduced further than requested.

        Raises:
            PocketGSError: a photograph is missing or not an image, or no pixel of it would be left.
        """
        preparation = self._prepared(shrink)
        stored, held = self._stored_sizes, self._held_sizes(preparation)
        undone = self._undistorted_sizes if preparation.lens != "ignore" else {}
        if preparation.lens == "direct" and undone:
            copies = {name: _scaled(undone.get(name, stored[name]), stored[name], size) for name, size in held.items()}
            models = frozenset(source.lens.model for source in self.listing.frames if source.name in undone)
            outline = self._outline(held, {}, shrink)
            return replace(outline, copies=self._outline(copies, undone, shrink), kept_lenses=models)
        return self._outline(held, undone, shrink)

    def _outline(self, held: Mapping[str, Size], undone: Mapping[str, Size], shrink: int) -> Outline:
        """The outline of photographs of these sizes, by name, some of whose lenses are undone, to sizes by name."""
        headers = self._headers

        def sizes(held_out: bool) -> tuple[Size, ...]:
            names = (source.name for source in self._sources)
            return tuple(held[name] for name in names if (name in self.held_out_names) == held_out)

        return Outline(
            training=sizes(held_out=False),
            held_out=sizes(held_out=True),
            stored_pixels=max(header.width * header.height for header in headers.values()),
            undone_pixels=max((width * height for width, height in undone.values()), default=0),
            lenses=len({self._undoing_of(source) for source in self._sources if source.name in undone}),
            pixel_bytes=max(_pixel_bytes(source, headers[source.name]) for source in self._sources),
            has_alpha=any(header.has_alpha for header in headers.values()) or self._cuts_out,
            read_again=_may_read_again(shrink),
        )

    def shrink_that_fits(self) -> int:
        """The least integer factor to reduce photographs by, so that all of them fit in the memory bound.

        Raises:
            PocketGSError: as `outline`; also if nothing of the photographs would be left.
        """
        shrink = 1
        while not fits(self.outline(shrink).image_bytes):
            shrink += 1
        return shrink

    def load(self, shrink: int = 1, readers: int = MAX_READERS) -> Capture:
        """Decode the photographs.

        Args:
            shrink: integer factor by which photographs are reduced further than requested.
            readers: maximum number of photographs to read at the same time, fewer if memory is short.

        Raises:
            PocketGSError: one of them cannot be used.
        """
        preparation, readers = self._prepared(shrink), min(readers, self._readers(shrink))
        damaged = dict(self._headers_and_damaged[1])
        loaded = load_frames(
            self._sources, preparation, readers, lambda source, error: damaged.__setitem__(source.name, error)
        )
        frames = [frame for frame in loaded if frame.mask is None or frame.mask.any()]
        warnings = self.listing.warnings + damaged_warning(damaged, len(self.listing.frames))
        warnings += masked_out_warning(loaded, frames)
        sources = [source for source in self._sources if source.name not in damaged]
        if self._cuts_out:
            frames = [replace(frame, mask=None) for frame in frames]  # they are alpha now
        if all(frame.name in self.held_out_names for frame in frames):
            raise PocketGSError(f"{self.path}: {warnings[-1]}; no frame is left to train on")
        train = [frame for frame in frames if frame.name not in self.held_out_names]
        if not self.background_is_given:
            preparation = replace(preparation, background=plain_background(train) or preparation.background)
        return Capture(
            name=self.name,
            path=self.path,
            format=self.listing.format,
            train=train,
            held_out=[frame for frame in frames if frame.name in self.held_out_names],
            points=self.listing.points,
            background=preparation.background,
            metric=self.listing.metric,
            origin=self.listing.origin,
            protocol=", ".join(
                [describe_images(sources, frames, preparation, self._is_reduced(preparation)), self.split]
            ),
            warnings=warnings
            + mask_warnings(sources, loaded, preparation.folder)
            + depth_warnings(sources, loaded, preparation.folder),
            photographs=StoredPhotographs(sources, self._of_pinholes, readers) if _may_read_again(shrink) else None,
        )

    @property
    def _cuts_out(self) -> bool:
        """Whether masks become alpha."""
        return self.preparation.outside_masks == "empty"

    @property
    def _headers(self) -> dict[str, ImageHeader]:
        """Headers by frame name, of the frames that have one."""
        return self._headers_and_damaged[0]

    @cached_property
    def _headers_and_damaged(self) -> tuple[dict[str, ImageHeader], dict[str, UndecodableImageError]]:
        """Headers by frame name, and the errors of photographs that have none because they are damaged.

        Raises:
            PocketGSError: a photograph is missing, or all to train on are damaged.
        """
        headers, damaged = {}, dict[str, UndecodableImageError]()
        with reading_inside(self.preparation.folder):
            for source in self.listing.frames:
                try:
                    headers[source.name] = header_of(source)
                except UndecodableImageError as error:
                    damaged[source.name] = error
        if self.held_out_names.issuperset(headers):
            raise next(error for name, error in damaged.items() if name not in self.held_out_names)
        return headers, damaged

    @property
    def _sources(self) -> list[FrameSource]:
        """The frames whose photographs have a header."""
        return [source for source in self.listing.frames if source.name in self._headers]

    def _readers(self, shrink: int) -> int:
        """Number of photographs to read at the same time.

        Raises:
            PocketGSError: the decoded photographs exceed the memory bound.
        """
        outline = self.outline(shrink)
        width, height = outline.largest
        count = len(self._sources)
        require_memory(self.path, outline.image_bytes, f"{count} photographs of up to {width}x{height} pixels")
        reading = max(each.reading_bytes for each in (outline, outline.copies) if each)
        return room_for(reading, MAX_READERS, held=outline.image_bytes)

    @cached_property
    def _undistorted_sizes(self) -> dict[str, Size]:
        """Sizes after undistortion by name, of the frames that have a lens. Most share it."""
        of_lens: dict[tuple, Size] = {}
        sizes = {}
        for source in self._sources:
            if source.lens.distorts:
                key = self._undoing_of(source)
                if key not in of_lens:
                    of_lens[key] = _undistorted_size(source, self._headers[source.name])
                sizes[source.name] = of_lens[key]
        return sizes

    def _undoing_of(self, source: FrameSource) -> tuple:
        """What the undistortion of a frame depends on."""
        header, camera = self._headers[source.name], source.camera
        stated = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
        return (source.lens, header.width, header.height, *stated)

    def _is_reduced(self, preparation: Preparation) -> bool:
        """Whether a photograph becomes smaller by more than cropping; a limit may be larger than all of them."""
        return self._held_sizes(preparation) != self._held_sizes(replace(preparation, downscale=1.0, max_size=None))

    def _held_sizes(self, preparation: Preparation) -> dict[str, Size]:
        """Sizes of the prepared photographs by frame name."""
        before = self._stored_sizes
        if preparation.lens == "undistort":
            before = before | self._undistorted_sizes
        return {source.name: _held_size(source, before[source.name], preparation) for source in self._sources}

    @property
    def _stored_sizes(self) -> dict[str, Size]:
        """Sizes of the photographs' files by frame name."""
        return {name: (header.width, header.height) for name, header in self._headers.items()}

    @property
    def _of_pinholes(self) -> Preparation:
        """How photographs are prepared when the geometry prior looks at them again: it knows no lens.

        They are not cut out, which would make features of the masks' edges.
        """
        whole = replace(self.preparation, outside_masks="unknown")
        return replace(whole, lens="undistort") if whole.lens == "direct" else whole

    def _prepared(self, shrink: int) -> Preparation:
        most = self.preparation.max_size
        return replace(
            self.preparation,
            downscale=self.preparation.downscale * shrink,
            max_size=None if most is None else max(1, most // shrink),
        )


def _may_read_again(shrink: int) -> bool:
    """Whether features may be found in larger photographs than those held: not where memory is too short for these."""
    return shrink == 1


def describe_images(sources: list[FrameSource], frames: list[Frame], preparation: Preparation, is_reduced: bool) -> str:
    """Text that says how the images were prepared; `frames` are those in use, one of which may be reduced."""
    distorted = any(source.lens.distorts for source in sources)
    sizes = {(frame.camera.width, frame.camera.height) for frame in frames}
    width, height = max(sizes)
    size = f"{width}x{height}" if len(sizes) == 1 else f"sizes up to {width}x{height}"
    if is_reduced:
        size = f"downscaled to {size}"
    if not distorted:
        words = [size]
    elif preparation.lens == "undistort":
        words = ["undistorted", f"cropped to {size}" if size[0].isdigit() else f"cropped, {size}"]
    elif preparation.lens == "direct":
        words = ["as photographed (lens in the renderer)", size]
    else:
        words = ["as published (distorted)", size]
    if preparation.background != BLACK or any(frame.alpha is not None for frame in frames):
        words.append(f"on {_colour_name(preparation.background)}")
    if preparation.outside_masks == "empty":
        words.append("cut out by masks")
    masked = sum(frame.mask is not None for frame in frames)
    if masked:
        words.append("masked" if masked == len(frames) else f"{masked} of {len(frames)} masked")
    return ", ".join(words)


def _colour_name(colour: Background) -> str:
    names = {(0.0, 0.0, 0.0): "black", (1.0, 1.0, 1.0): "white"}
    return names.get(colour, "RGB ({:g}, {:g}, {:g})".format(*colour))


def _undistorted_size(source: FrameSource, header: ImageHeader) -> Size:
    """Size after undistortion: smaller where the lens pulls corners outwards, larger where it pulls them in."""
    camera = camera_of_size(source, header.width, header.height)
    try:
        left, top, right, bottom = inner_rectangle(camera, source.lens)
    except PocketGSError as error:
        raise PocketGSError(f"{source.image}: {error}") from error
    return right - left, bottom - top


def _held_size(source: FrameSource, size: Size, preparation: Preparation) -> Size:
    width, height = (side - 2 * source.border for side in size)
    try:
        return size_after(width, height, preparation.downscale, preparation.max_size)
    except PocketGSError as error:
        raise PocketGSError(f"{source.image}: {error}") from error


def _scaled(size: Size, stored: Size, held: Size) -> Size:
    """A size for photographs as stored, of at least one pixel, where these are held at another size."""
    width, height = (-(-side * now // before) for side, before, now in zip(size, stored, held, strict=True))
    return width, height


def _pixel_bytes(source: FrameSource, header: ImageHeader) -> int:
    """Bytes per pixel: RGB, and alpha, mask (one byte each) and depth (float32) if the frame has them."""
    return RGB_BYTES + header.has_alpha + (source.mask_path is not None) + 4 * (source.depth_path is not None)
