"""The photographs of a finished run as its training saw them: without what moved between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.results.cameras_file import read_cameras
from pocketgs.results.checkpoint import CHECKPOINT, read_transients
from pocketgs.results.folder import CAMERAS
from pocketgs.training.transients import mask_without

OTHER_VIEWS = (
    "its run masked what moved between the photographs, but had other training views: nothing is masked here; give the "
    "options that it was trained with, such as --images or --hold-out"
)


def without_transients(capture: Capture, cells: Sequence[np.ndarray] | None) -> Capture:
    """The capture with the cells of its training views masked.

    Args:
        capture: with the run's training views.
        cells: (h, w) bool for each of them; None if none were looked for.
    """
    if cells is None:
        return capture
    pairs = zip(capture.train, cells, strict=True)
    return replace(capture, train=[replace(frame, mask=mask_without(frame, part)) for frame, part in pairs])


def without_transients_of(folder: Path, capture: Capture, on_warning: Callable[[str], None]) -> Capture:
    """The capture without the transients that the run of a result folder has found in its training views.

    It is returned as it is if the folder knows of none, or, with a warning, if its run had other training views.

    Args:
        folder: a result folder, or any other.
        capture: of the run. Training views that the run has dropped stay as they are.
        on_warning: called with the warning.

    Raises:
        PocketGSError: a file of the result cannot be read.
    """
    if not all((folder / name).is_file() for name in (CHECKPOINT, CAMERAS)):
        return capture
    cells, names = read_transients(folder / CHECKPOINT), read_cameras(folder / CAMERAS).cameras
    trained = [frame.name for frame in capture.train if frame.name in names]
    if cells is None:
        return capture
    if len(cells) != len(trained):
        if any(of_view.any() for of_view in cells):
            on_warning(OTHER_VIEWS)
        return capture
    cells_of = dict(zip(trained, cells, strict=True))
    nothing = np.zeros((1, 1), np.bool_)
    return without_transients(capture, [cells_of.get(frame.name, nothing) for frame in capture.train])
