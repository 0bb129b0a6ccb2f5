"""Edits of sort-free scenes: the same as of other scenes, applied to the weights too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.scene import SortFreeScene


def edited(scene: SortFreeScene, edit: Callable[[Gaussians], Gaussians], factor: float = 1.0) -> SortFreeScene:
    """A scene after an edit of its Gaussians.

    Args:
        scene: to edit.
        edit: selects, moves, rotates or scales Gaussians; it leaves the degree of their harmonics as it is.
        factor: that it scales by.
    """
    gaussians = edit(scene.gaussians)
    visibility_sh = np.zeros((len(gaussians), 0), np.float32)
    if scene.visibility_sh.shape[1]:
        # v depends on directions as colours do, so what happens to colours happens to it.
        twin = replace(scene.gaussians, sh=np.repeat(scene.visibility_sh[..., None], 3, axis=2))
        visibility_sh = np.ascontiguousarray(edit(twin).sh[..., 0])
    return replace(scene, gaussians=gaussians, unit=scene.unit * factor, visibility_sh=visibility_sh)
