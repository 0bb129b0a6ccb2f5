"""A sort-free scene as a 3DGS `.ply` with what its weights are made from.

Each vertex has the properties view_0, view_1, … beside those of the layout, and comments of the header say the rest:

    comment sort_free visibility
    comment sort_free_unit 3.75
    comment sort_free_sigma 2.5

Other programs read such a file as a scene that is drawn sorted, which is not how it was trained.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.ply_file import read_comments, read_vertices
from pocketgs.scene.formats.ply import read_gaussians, write_gaussians
from pocketgs.sort_free.forms import form_named
from pocketgs.sort_free.scene import SortFreeScene

MARK = "sort_free"


def write_ply(path: Path, scene: SortFreeScene) -> None:
    """Write a scene atomically.

    Raises:
        PocketGSError: the file cannot be written.
    """
    comments = [f"{MARK} {scene.form.name}", f"{MARK}_unit {float(scene.unit)!r}"]
    numbers = np.exp(scene.log_shared)
    comments += [f"{MARK}_{name} {float(value)!r}" for name, value in zip(scene.form.numbers, numbers, strict=True)]
    properties = {f"view_{k}": scene.visibility_sh[:, k] for k in range(scene.visibility_sh.shape[1])}
    write_gaussians(path, scene.gaussians, properties, comments)


def is_marked(path: Path) -> bool:
    """Whether a `.ply` holds a sort-free scene."""
    return MARK in _comments(path)


def read_ply(path: Path) -> SortFreeScene:
    """Read a scene.

    Raises:
        PocketGSError: the file is missing or broken, or is no sort-free scene.
    """
    comments = _comments(path)
    if MARK not in comments:
        raise PocketGSError(f"{path}: found no comment '{MARK} …', expected a sort-free scene")
    try:
        form = form_named(comments[MARK])
    except PocketGSError as error:
        raise PocketGSError(f"{path}: {error}") from error
    unit, *numbers = (_positive(path, comments, f"{MARK}_{name}") for name in ("unit", *form.numbers))
    gaussians, vertices = read_gaussians(path), read_vertices(path)
    columns: list[np.ndarray] = []
    while (name := f"view_{len(columns)}") in (vertices.dtype.names or ()) and vertices.dtype[name].kind != "O":
        columns.append(np.asarray(vertices[name], np.float32))
    visibility_sh = np.stack(columns, axis=1) if columns else np.zeros((len(gaussians), 0), np.float32)
    try:
        return SortFreeScene(gaussians, form, unit, np.log(numbers), visibility_sh)
    except PocketGSError as error:
        raise PocketGSError(f"{path}: {error}") from error


def _comments(path: Path) -> dict[str, str]:
    """The header's comments of ours, by their first word."""
    words = [comment.split(maxsplit=1) for comment in read_comments(path)]
    return {found[0]: found[1] for found in words if len(found) == 2 and found[0].startswith(MARK)}


def _positive(path: Path, comments: dict[str, str], name: str) -> float:
    try:
        value = float(comments.get(name, ""))
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise PocketGSError(f"{path}: comment {name!r} is {comments.get(name)!r}, expected a positive number")
    return value
