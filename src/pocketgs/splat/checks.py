"""Input checks shared by all engines. Kernels have no bounds checks of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.parameters import ParameterLayout


def check_masks(masks: Sequence[np.ndarray | None], sizes: Sequence[tuple[int, int]]) -> None:
    """Raise PocketGSError unless there is one mask or None per photograph, of its (width, height)."""
    if len(masks) != len(sizes):
        raise PocketGSError(f"masks: found {len(masks)}, expected one for each of {len(sizes)} photographs")
    for index, (mask, (width, height)) in enumerate(zip(masks, sizes, strict=True)):
        if mask is not None and (mask.shape != (height, width) or mask.dtype != np.bool_):
            found = f"found {mask.dtype} of shape {mask.shape}"
            raise PocketGSError(f"mask {index}: {found}, expected bool of shape {(height, width)}")


def checked_scene(gaussians: Gaussians) -> Gaussians:
    """Check a scene again, whose arrays may have been replaced since it was made.

    Raises:
        PocketGSError: it is not a scene, or its arrays disagree.
    """
    if not isinstance(gaussians, Gaussians):
        raise PocketGSError(f"upload: found {type(gaussians).__name__}, expected Gaussians")
    return Gaussians(*(getattr(gaussians, name) for name in PARAMETERS))


def check_state(gaussians: Gaussians, state: OptimiserState) -> None:
    """Check that an optimiser's state belongs to the scene.

    Raises:
        PocketGSError: it has another shape or type, or its step count is invalid.
    """
    shape = (len(gaussians), ParameterLayout(gaussians.sh.shape[1]).columns)
    for name in ("first_moments", "second_moments"):
        moments = np.asarray(getattr(state, name))
        if moments.shape != shape or moments.dtype != np.float32:
            raise PocketGSError(f"upload: {name} are {moments.dtype} {moments.shape}, expected float32 {shape}")
    if not isinstance(state.steps, int | np.integer) or state.steps < 0:
        raise PocketGSError(f"upload: the state counts {state.steps!r} steps, expected 0 or more")


def check_view(view: int, views: Sequence[object]) -> None:
    """Check the index of a view.

    Raises:
        PocketGSError: there is no such view.
    """
    if not views:
        raise PocketGSError("step: there are no views, expected a call of set_views before")
    if not isinstance(view, int | np.integer) or not 0 <= view < len(views):
        raise PocketGSError(f"step: found view {view!r}, expected 0 to {len(views) - 1}: set_views gives {len(views)}")
