"""A crop of a held-out view, from the photograph and from each method's rendering."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from pocketgs.benchmark.aggregate import number, rows_of
from pocketgs.benchmark.results import CellResult
from pocketgs.errors import PocketGSError
from pocketgs.files.journal import settle
from pocketgs.files.plain_names import plain_names
from pocketgs.results.folder import PICTURES, RECORD

CROP = (200, 150)
"""Maximum width and height in pixels."""


@dataclass(frozen=True)
class Crop:
    """The same crop of a view in several images.

    Attributes:
        view: name of the view's image.
        left, top: position of the crop in the view, in pixels.
        photo: (H, W, 3) uint8, the photograph.
        renderings: (H, W, 3) uint8 by method, from the method's first run with images.
        psnr: of the whole view in dB, by method, where the run recorded it.
    """

    view: str
    left: int
    top: int
    photo: np.ndarray
    renderings: dict[str, np.ndarray]
    psnr: dict[str, float]


def choose_crop(results: Sequence[CellResult], capture: str, pictures: Path) -> Crop | None:
    """The crop of all held-out views where the methods differ most; with one method, the one with most detail.

    Methods with other views or image sizes than the first are left out, and so are views with unreadable images.

    Args:
        results: in any order.
        capture: its name.
        pictures: folder with a result folder per cell, by the cell's name.

    Returns:
        The crop, or None if there are no images of the capture's runs.
    """
    runs = _runs_with_pictures(results, capture, pictures)
    if not runs:
        return None
    shared = set.intersection(*(set(views) for _, views in runs.values()))
    best, best_score = None, -1.0
    for view in sorted(shared):
        try:
            photo, renderings = _open_view({method: views[view] for method, (_, views) in runs.items()})
        except (OSError, SyntaxError):  # raised by Pillow for damaged images
            continue
        left, top, score = _most_telling(photo, renderings)
        if score > best_score:
            best_score = score
            best = (view, left, top, photo, renderings)
    if best is None:
        return None
    view, left, top, photo, renderings = best
    piece = (slice(top, top + CROP[1]), slice(left, left + CROP[0]))
    psnr = {method: found for method in renderings if (found := _psnr_of(runs[method][0], view)) is not None}
    cut = {method: rendered[piece] for method, rendered in renderings.items()}
    return Crop(view, left, top, photo[piece], cut, psnr)


def _runs_with_pictures(
    results: Sequence[CellResult], capture: str, pictures: Path
) -> dict[str, tuple[CellResult, dict[str, Path]]]:
    """Each method's first run with images, with its files by view; methods with other views are left out."""
    runs: dict[str, tuple[CellResult, dict[str, Path]]] = {}
    expected: set[str] | None = None
    for row in rows_of(results, capture):
        for result in row.results:
            folder = pictures / result.cell.name
            files = sorted((folder / PICTURES).glob("*.png")) if _is_of(folder, result) else []
            views = {file.stem: file for file in files}
            expected = expected or set(views)
            if views and row.method not in runs and set(views) == expected:
                runs[row.method] = (result, views)
    return runs


def _is_of(folder: Path, result: CellResult) -> bool:
    """Whether a folder holds the files of this result's run, and not those of another run of the cell."""
    try:
        settle(folder)
        left = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError, PocketGSError):
        return False
    return isinstance(left, dict) and left.get("psnr") == result.run.get("psnr")


def _open_view(files: Mapping[str, Path]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The photograph of a view and its renderings by method; those of other sizes are left out."""
    photo: np.ndarray | None = None
    renderings = {}
    for method, file in files.items():
        with Image.open(file) as picture:
            pair = np.asarray(picture.convert("RGB"))
        width = pair.shape[1] // 2
        photo = pair[:, :width] if photo is None else photo
        if pair[:, width:].shape == photo.shape:
            renderings[method] = pair[:, width:]
    assert photo is not None
    return photo, renderings


def _most_telling(photo: np.ndarray, renderings: Mapping[str, np.ndarray]) -> tuple[int, int, float]:
    """Left and top of the window with the largest mean difference between methods, and that mean."""
    if len(renderings) > 1:
        telling = np.std([rendered.astype(np.float32) for rendered in renderings.values()], axis=0).mean(axis=2)
    else:
        grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY).astype(np.float32)
        telling = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    height, width = telling.shape
    across, down = min(CROP[0], width), min(CROP[1], height)
    # Window sums from a summed-area table.
    sums = cv2.integral(telling, sdepth=cv2.CV_64F)
    windows = sums[down:, across:] - sums[:-down, across:] - sums[down:, :-across] + sums[:-down, :-across]
    top, left = np.unravel_index(np.argmax(windows), windows.shape)
    return int(left), int(top), float(windows[top, left] / (across * down))


def _psnr_of(result: CellResult, view: str) -> float | None:
    images = result.run.get("images") or []
    names = plain_names(str(image.get("name")) for image in images)
    return next((number(image.get("psnr")) for image, name in zip(images, names, strict=True) if name == view), None)
