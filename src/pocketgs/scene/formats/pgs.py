"""PocketGS' own `.pgs`: the smallest file of a scene, in Morton order.

Parameters are rounded to grids (`pgs_rounding.py`), and the multiples of the grids' steps are coded by an adaptive
range coder (`range_coder.py`) with what their neighbours tell (`pgs_positions.py`, `pgs_attributes.py`).
`pgs_sections.py` is the container. docs/formats.md has the layout.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.scene.formats import pgs_attributes as attributes
from pocketgs.scene.formats.checks import read_contents, require_any, require_room, require_sound
from pocketgs.scene.formats.coarseness import warn_if_coarse
from pocketgs.scene.formats.pgs_coding import DEFAULT, Coding
from pocketgs.scene.formats.pgs_columns import MAX_NUMBER, Columns, ReadColumns, WrittenColumns
from pocketgs.scene.formats.pgs_positions import MAX_BITS, decode_positions, encode_positions, morton_sorted
from pocketgs.scene.formats.pgs_rotations import fineness_of, quaternions_of, steps_of, turn_levels
from pocketgs.scene.formats.pgs_rounding import (
    MAX_ENTRIES,
    distinct_rows,
    finest_exponent,
    grid_exponent,
    levels,
    rounded,
)
from pocketgs.scene.formats.pgs_sections import (
    COLUMNS,
    FIELDS,
    TREE,
    WEIGHTS,
    Section,
    join_sections,
    names_in,
    split_sections,
)
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians

SCENE = struct.Struct("<IIBBh3i5f")
"""Count, entries of the codebook, degree, bits and exponent of positions, origin, and the steps of log scales,
rotations, opacity logits, colours and harmonics."""

LARGEST_COORDINATE = 2.0**127
"""Larger ones might be rounded to beyond float32."""

KNOWN = {
    ("scene", FIELDS),
    ("position", TREE),
    ("scale", COLUMNS),
    ("rotation", COLUMNS),
    ("opacity", COLUMNS),
    ("colour", COLUMNS),
    ("codebook", COLUMNS),
    ("harmonic", COLUMNS),
}
# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (250, 66)


@dataclass(frozen=True)
class Layout:
    """The fields of the section `scene`."""

    count: int
    entries: int
    degree: int
    bits: int
    exponent: int
    origin: tuple[int, int, int]
    log_scale: float
    rotation: float
    opacity: float
    colour: float
    harmonics: float


def write_gaussians(path: Path, gaussians: Gaussians, coding: Coding = DEFAULT) -> None:
    """Write a scene atomically, rounded.

    Raises:
        PocketGSError: the scene is empty, too large, or holds NaN or infinity, or the file cannot be written.
    """
    contents = encode(gaussians, coding, path)
    with replacing(path) as partial:
        partial.write_bytes(contents)


def encode(gaussians: Gaussians, coding: Coding = DEFAULT, path: Path = Path("scene.pgs")) -> bytes:
    """Encode a scene, rounded, as the content of a file.

    Args:
        gaussians: the scene.
        coding: the steps of rounding.
        path: for messages.

    Raises:
        PocketGSError: the scene is empty, too large, or holds NaN or infinity.
    """
    return join_sections(encoded(gaussians, coding, path)[0])


def decode(contents: bytes) -> Gaussians:
    """Decode a scene from the contents of a file; raises what `read_gaussians` does."""
    path = Path("scene.pgs")
    return decoded(path, split_sections(path, contents, KNOWN))


def require_storable(path: Path, gaussians: Gaussians) -> None:
    """Check that a file can hold a scene.

    Raises:
        PocketGSError: the scene is empty, too large, or holds NaN or infinity.
    """
    require_sound(path, gaussians)
    _require_count(path, len(gaussians))
    if (largest := float(np.abs(gaussians.means).max())) > LARGEST_COORDINATE:
        raise PocketGSError(
            f"{path}: a coordinate of {largest:.3g}, expected at most {LARGEST_COORDINATE:.3g} in a .pgs"
        )


def encoded(gaussians: Gaussians, coding: Coding, path: Path) -> tuple[list[Section], np.ndarray]:
    """Encode a scene, rounded, as sections; and (N,) the indices of its Gaussians in the order of the file.

    Arguments and errors are those of `encode`.
    """
    require_storable(path, gaussians)
    coding = coding.in_single_precision()
    scene = rounded(gaussians, coding)
    if grid_exponent(gaussians.means) is None:
        warn_of_coarse_grid(path, gaussians)
    exponent = grid_exponent(scene.means)
    assert exponent is not None
    cells = np.ldexp(scene.means.astype(np.float64), -exponent).astype(np.int64)
    origin = cells.min(axis=0)
    cells -= origin
    bits = int(cells.max()).bit_length()
    order = morton_sorted(cells)
    cells, scene = cells[order], scene.select(order)
    around = attributes.surroundings_of(cells)
    scales = levels(scene.log_scales, coding.log_scale)
    steps = steps_of(scales * coding.log_scale, coding.rotation)
    rest = levels(scene.sh[:, 1:], coding.harmonics)
    entries, harmonics = _harmonics(rest)
    fields = SCENE.pack(
        len(scene),
        entries,
        scene.sh_degree,
        bits,
        exponent,
        *origin.tolist(),
        coding.log_scale,
        coding.rotation,
        coding.opacity,
        coding.colour,
        coding.harmonics,
    )
    sections = [
        Section("scene", FIELDS, fields),
        Section("position", TREE, encode_positions(cells, bits)),
        columns_of("scale", attributes.code_scales, scales, around),
        columns_of(
            "rotation",
            attributes.code_turns,
            turn_levels(scene.quaternions, steps),
            fineness_of(scales * coding.log_scale),
        ),
        columns_of("opacity", attributes.code_opacities, levels(scene.opacity_logits, coding.opacity)),
        columns_of("colour", attributes.code_colours, levels(scene.sh[:, 0], coding.colour), around),
        *harmonics,
    ]
    return sections, order


def warn_of_coarse_grid(path: Path, gaussians: Gaussians) -> None:
    """Warn if rounding to a file's grid, which suits the farthest Gaussian, moves most of them visibly."""
    warn_if_coarse(path, gaussians, math.ldexp(1.0, finest_exponent(gaussians.means) + 1))


def _harmonics(rest: np.ndarray) -> tuple[int, list[Section]]:
    """Number of the codebook's entries, or 0 for none, and the sections of (N, K - 1, 3) levels above degree 0."""
    if not rest.size:
        return 0, []
    book, labels = distinct_rows(rest.reshape(len(rest), -1))
    choices: list[tuple[int, list[Section]]] = []
    if len(book) <= MAX_ENTRIES:
        entries = columns_of("codebook", attributes.code_harmonics, book.reshape(-1, *rest.shape[1:]))
        choices.append((len(book), [entries, columns_of("harmonic", attributes.code_labels, labels)]))
    if not choices or 2 * len(book) > len(rest):
        # Where hardly any Gaussians share an entry, it may take less to store what each has.
        choices.append((0, [columns_of("harmonic", attributes.code_harmonics, rest)]))
    return min(choices, key=lambda choice: sum(len(section.content) for section in choice[1]))


def columns_of(name: str, code: Callable[..., None], table: np.ndarray, *given: object) -> Section:
    """A section of a table's columns.

    Args:
        name: of the section.
        code: describes the columns, see `pgs_attributes.py`.
        table: (N, …) integers.
        given: what the description needs besides.
    """
    columns = WrittenColumns()
    code(columns, table, *given)
    return Section(name, COLUMNS, columns.finish())


def read_gaussians(path: Path) -> Gaussians:
    """Read a scene.

    Raises:
        PocketGSError: the file is missing, damaged, of another version, or exceeds the memory bound, or the scene is
            drawn without sorting.
    """
    contents = read_contents(path)
    if WEIGHTS in names_in(contents):
        raise PocketGSError(f"{path}: a scene that is drawn without sorting, expected one that is sorted")
    return decoded(path, split_sections(path, contents, KNOWN))


def decoded(path: Path, sections: dict[str, bytes]) -> Gaussians:
    """Decode a scene from the sections of a file, which errors name.

    Raises:
        PocketGSError: a section is missing or broken, or the scene exceeds the memory bound.
    """
    layout = _layout(path, sections)
    count = layout.count
    cells = decode_positions(sections["position"], count, layout.bits)
    around = attributes.surroundings_of(cells)

    def read(name: str, code: Callable[..., None], shape: tuple[int, ...], *given: object) -> np.ndarray:
        return table_of(path, sections[name], code, shape, *given)

    log_scales = read("scale", attributes.code_scales, (count, 3), around) * layout.log_scale
    turns = read("rotation", attributes.code_turns, (count, 3), fineness_of(log_scales))
    opacities = read("opacity", attributes.code_opacities, (count,)) * layout.opacity
    colours = read("colour", attributes.code_colours, (count, 3), around) * layout.colour
    sh = np.zeros((count, SH_COEFFICIENTS[layout.degree], 3))
    sh[:, 0] = colours
    if layout.degree and not layout.entries:
        sh[:, 1:] = read("harmonic", attributes.code_harmonics, sh[:, 1:].shape) * layout.harmonics
    elif layout.degree:
        book = read("codebook", attributes.code_harmonics, (layout.entries, sh.shape[1] - 1, 3)) * layout.harmonics
        labels = read("harmonic", attributes.code_labels, (count,))
        if labels.min() < 0 or labels.max() >= layout.entries:
            raise PocketGSError(f"{path}: broken: an entry outside the codebook of {layout.entries:,}")
        sh[:, 1:] = book[labels]
    # Numbers beyond float32 become infinite, and are refused below.
    with np.errstate(over="ignore", invalid="ignore"):
        gaussians = Gaussians(
            np.ldexp((cells + np.array(layout.origin)).astype(np.float64), layout.exponent),
            log_scales,
            quaternions_of(turns * steps_of(log_scales, layout.rotation)),
            opacities,
            sh,
        )
    require_sound(path, gaussians)
    return gaussians


def table_of(
    path: Path, section: bytes, code: Callable[..., None], shape: tuple[int, ...], *given: object
) -> np.ndarray:
    """The table whose columns are in a section, (N, …) int64; `columns_of` describes the arguments.

    Raises:
        PocketGSError: it holds numbers beyond all bounds.
    """
    table = np.zeros(shape, np.int64)
    columns: Columns = ReadColumns(path, section)
    code(columns, table, *given)
    return table


def _layout(path: Path, sections: dict[str, bytes]) -> Layout:
    """The fields of a file whose sections are complete and fit in memory.

    Raises:
        PocketGSError: they are not, or a field is out of range.
    """
    if len(sections.get("scene", b"")) != SCENE.size:
        raise PocketGSError(f"{path}: section 'scene' is missing or not of {SCENE.size} bytes")
    count, entries, degree, bits, exponent, x, y, z, *steps = SCENE.unpack(sections["scene"])
    if degree >= len(SH_COEFFICIENTS):
        raise PocketGSError(f"{path}: spherical harmonics of degree {degree}, expected 0 to 3")
    absent = {"codebook", "harmonic"} if not degree else set() if entries else {"codebook"}
    needed = {name for name, _ in KNOWN} - absent
    if missing := sorted(needed - sections.keys()):
        raise PocketGSError(f"{path}: section {missing[0]!r} is missing")
    require_any(path, count)
    _require_count(path, count)
    if entries > MAX_ENTRIES:
        raise PocketGSError(f"{path}: a codebook of {entries:,}, expected at most {MAX_ENTRIES:,}")
    if bits > MAX_BITS:
        raise PocketGSError(f"{path}: positions of {bits} bits, expected at most {MAX_BITS}")
    if not all(0 < step < np.inf for step in steps):
        raise PocketGSError(f"{path}: steps {steps}, expected positive numbers")
    require_room(path, count, SH_COEFFICIENTS[degree], READING)
    return Layout(count, entries, degree, bits, exponent, (x, y, z), *steps)


def _require_count(path: Path, count: int) -> None:
    if count > MAX_NUMBER:
        raise PocketGSError(f"{path}: {count:,} Gaussians, expected at most {MAX_NUMBER:,} in a .pgs")
