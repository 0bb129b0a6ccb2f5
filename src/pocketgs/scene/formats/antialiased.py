"""Marks of scenes that were trained with Mip-Splatting's 2D filter, which fades Gaussians smaller than a pixel.

Scenes are drawn without the filter, so these look too opaque where they are small.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pocketgs.scene.warning import warn

MARK = "SplatRenderMode: mip"
"""Comment of a `.ply` that marks a scene."""


def is_marked(comments: Iterable[str]) -> bool:
    """Whether comments of a `.ply` mark a scene: `SplatRenderMode: mip` (Brush) or `antialiased 1` (Postshot).

    The last of such comments decides.
    """
    marked = False
    for comment in comments:
        words = comment.lower().replace(":", " ").split()
        if len(words) == 2 and words[0] in ("splatrendermode", "antialiased"):
            marked = words[1] in ("mip", "1")
    return marked


def warn_if(marked: bool, path: Path) -> None:
    """Warn that a scene that is marked looks too opaque."""
    if marked:
        warn(
            f"{path}: trained with anti-aliasing, but drawn without: Gaussians smaller than a pixel are too opaque, "
            "and the smaller the picture, the thicker fine things look"
        )
