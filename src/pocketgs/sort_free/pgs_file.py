"""A sort-free scene as a `.pgs` with two more sections.

`weights` holds fields: the form's name (16 bytes of ASCII, padded with zeros), the number of coefficients of each v and
of the form's numbers (u8 each), two zeros, the step that coefficients are multiples of (f32), the unit (f64), and the
natural logarithms of the numbers (f64 each). `view` holds the coefficients' columns; it is absent where there are none.
Readers must not skip them: sorted, the scene would look different.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.memory_bound import require_memory
from pocketgs.scene.formats import pgs
from pocketgs.scene.formats.checks import read_contents
from pocketgs.scene.formats.pgs_attributes import code_views
from pocketgs.scene.formats.pgs_coding import CODINGS
from pocketgs.scene.formats.pgs_rounding import levels
from pocketgs.scene.formats.pgs_sections import (
    COLUMNS,
    FIELDS,
    WEIGHTS,
    Section,
    join_sections,
    split_sections,
    text_of,
)
from pocketgs.scene.formats.spz_precision import Detail
from pocketgs.sort_free.forms import form_named
from pocketgs.sort_free.scene import SortFreeScene

HEAD = struct.Struct("<16sBBHfd")
VIEW = "view"
KNOWN = {*pgs.KNOWN, (WEIGHTS, FIELDS), (VIEW, COLUMNS)}

STEPS: dict[Detail, float] = {"fine": 0.2, "small": 0.4}
"""Of the coefficients of v."""

READING = 40
"""Maximum bytes that reading takes per coefficient of v."""


def write_pgs(path: Path, scene: SortFreeScene, detail: Detail = "fine") -> None:
    """Write a scene atomically, rounded.

    Raises:
        PocketGSError: the scene is empty, too large, or holds NaN or infinity, or the file cannot be written.
    """
    contents = encode(scene, detail, path)
    with replacing(path) as partial:
        partial.write_bytes(contents)


def encode(scene: SortFreeScene, detail: Detail = "fine", path: Path = Path("scene.pgs")) -> bytes:
    """Encode a scene, rounded, as the content of a file.

    Args:
        scene: to encode.
        detail: how finely parameters are rounded.
        path: for messages.

    Raises:
        PocketGSError: the scene is empty, too large, or holds NaN or infinity.
    """
    if not np.isfinite(scene.visibility_sh).all():
        raise PocketGSError(f"{path}: views hold NaN or infinity, expected finite numbers")
    sections, order = pgs.encoded(scene.gaussians, CODINGS[detail], path)
    step, coefficients = float(np.float32(STEPS[detail])), scene.visibility_sh.shape[1]
    head = HEAD.pack(
        scene.form.name.encode("ascii"), coefficients, len(scene.log_shared), 0, step, float(scene.unit)
    ) + struct.pack(f"<{len(scene.log_shared)}d", *scene.log_shared)
    sections.append(Section(WEIGHTS, FIELDS, head))
    if coefficients:
        sections.append(pgs.columns_of(VIEW, code_views, levels(scene.visibility_sh[order], step)))
    return join_sections(sections)


def read_pgs(path: Path) -> SortFreeScene:
    """Read a scene.

    Raises:
        PocketGSError: the file is missing, damaged, of another version, exceeds the memory bound, or is no sort-free
            scene.
    """
    sections = split_sections(path, read_contents(path), KNOWN)
    fields = sections.get(WEIGHTS, b"")
    if len(fields) < HEAD.size:
        raise PocketGSError(f"{path}: section {WEIGHTS!r} is missing or too short, expected a sort-free scene")
    name, coefficients, count, _, step, unit = HEAD.unpack_from(fields)
    if len(fields) != HEAD.size + 8 * count or not (0.0 < step < math.inf):
        raise PocketGSError(f"{path}: section {WEIGHTS!r} of {len(fields)} bytes for {count} numbers, step {step:g}")
    if coefficients and VIEW not in sections:
        raise PocketGSError(f"{path}: section {VIEW!r} is missing")
    gaussians = pgs.decoded(path, sections)
    require_memory(path, READING * coefficients * len(gaussians), f"{coefficients} coefficients of each weight")
    visibility_sh = np.zeros((len(gaussians), coefficients), np.float32)
    if coefficients:
        with np.errstate(over="ignore"):
            visibility_sh[:] = pgs.table_of(path, sections[VIEW], code_views, visibility_sh.shape) * step
    try:
        form = form_named(text_of(name))
        log_shared = np.array(struct.unpack_from(f"<{count}d", fields, HEAD.size))
        return SortFreeScene(gaussians, form, unit, log_shared, visibility_sh)
    except PocketGSError as error:
        raise PocketGSError(f"{path}: {error}") from error
