"""A capture's photographs in files, which can be decoded again at another size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from pocketgs.capture.capture import Frame, Result
from pocketgs.capture.frame_parts import header_of
from pocketgs.capture.listing import FrameSource
from pocketgs.capture.loading import MAX_READERS, Preparation, map_frames


@dataclass(frozen=True)
class StoredPhotographs:
    """Photographs in files; implements `pocketgs.capture.capture.Photographs`.

    Attributes:
        sources: the frames.
        preparation: applied to every image, except for its size limits.
        readers: number of photographs to read at the same time.
    """

    sources: list[FrameSource]
    preparation: Preparation
    readers: int = MAX_READERS

    @cached_property
    def longest_side(self) -> int:
        """Longest side of any stored photograph, in pixels."""
        headers = [header_of(source) for source in self.sources]
        return max(max(header.width, header.height) for header in headers)

    def map(self, look: Callable[[Frame], Result], max_size: int) -> dict[str, Result]:
        """Apply `look` to every frame, decoded at most `max_size` pixels a side, and return the results by name.

        Raises:
            PocketGSError: a photograph cannot be used.
        """
        preparation = replace(self.preparation, downscale=1.0, max_size=max_size)
        found = map_frames(self.sources, preparation, look, self.readers)
        return dict(zip((source.name for source in self.sources), found, strict=True))
