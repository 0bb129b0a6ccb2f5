"""PlayCanvas' `.compressed.ply`: 16 bytes per Gaussian, and one for each coefficient of spherical harmonics.

Gaussians are in Morton order, in chunks of 256. The element `chunk` holds the minima and maxima of a chunk's centres,
log scales and colours; `vertex` quantises each Gaussian between them: 11, 10 and 11 bits for x, y, z of centre and log
scale, 8 bits each for red, green, blue and opacity, and 2 + 3 x 10 bits for the rotation without its largest component.
The optional element `sh` holds the coefficients above degree 0 as bytes that span -4 to 4, channel by channel.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.ply_file import read_comments, read_elements
from pocketgs.files.ply_header import MAX_HEADER_BYTES, header_in
from pocketgs.geometry.quaternions import MAX_OTHER, drop_largest, restore_largest, unit
from pocketgs.scene.formats import antialiased
from pocketgs.scene.formats.activations import colour_of, dc_of, opacity_from_byte, opacity_of
from pocketgs.scene.formats.checks import require_room, require_sound
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians
from pocketgs.scene.morton import morton_order

CHUNK = 256
CENTRE = ("min_x", "min_y", "min_z", "max_x", "max_y", "max_z")
SCALE = ("min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z")
COLOUR = ("min_r", "min_g", "min_b", "max_r", "max_g", "max_b")
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
MAX_LOG_SCALE = 20.0
# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (280, 80)

SH_RANGE, SH_STEPS = 8.0, 256
"""Number of quantisation steps from -4 to 4; a byte decodes to the middle of its step."""

# Width and shift of each field of a 32-bit word, highest first.
THREE_FIELDS = ((11, 21), (10, 11), (11, 0))
FOUR_FIELDS = ((8, 24), (8, 16), (8, 8), (8, 0))
ROTATION_FIELDS = ((10, 20), (10, 10), (10, 0))


def recognises(path: Path) -> bool:
    """Whether a `.ply` is compressed in this format."""
    try:
        with path.open("rb") as file:
            start = file.read(MAX_HEADER_BYTES)
    except OSError:
        return False
    header = header_in(start) or start
    return b"element chunk" in header and PACKED[0].encode() in header


def write_gaussians(path: Path, gaussians: Gaussians) -> None:
    """Write a scene atomically, in Morton order.

    Raises:
        PocketGSError: the scene is empty or holds NaN or infinity, or the file cannot be written.
    """
    require_sound(path, gaussians)
    ordered = gaussians.select(morton_order(gaussians.means))
    log_scales = np.clip(ordered.log_scales, -MAX_LOG_SCALE, MAX_LOG_SCALE)
    centre_extremes, centres = _within_chunks(ordered.means)
    scale_extremes, scales = _within_chunks(log_scales)
    colour_extremes, colours = _within_chunks(colour_of(ordered.sh[:, 0]))
    largest, others = drop_largest(unit(ordered.quaternions))
    words = [
        _pack(centres, THREE_FIELDS),
        _pack(others * MAX_OTHER + 0.5, ROTATION_FIELDS) | largest.astype(np.uint32) << 30,
        _pack(scales, THREE_FIELDS),
        _pack(np.concatenate([colours, opacity_of(ordered.opacity_logits)[:, None]], axis=1), FOUR_FIELDS),
    ]
    extremes = np.concatenate([centre_extremes, scale_extremes, colour_extremes], axis=1)
    elements = [
        _element("chunk", CENTRE + SCALE + COLOUR, extremes.astype("<f4")),
        _element("vertex", PACKED, np.stack(words, axis=1).astype("<u4")),
    ]
    if ordered.sh_degree:
        rest = np.swapaxes(ordered.sh[:, 1:], 1, 2).reshape(len(ordered), -1)
        levels = np.floor((rest.astype(np.float64) / SH_RANGE + 0.5) * SH_STEPS)
        elements.append(_element("sh", _rest_names(rest.shape[1]), np.clip(levels, 0, SH_STEPS - 1).astype("u1")))
    with replacing(path) as partial:
        PlyData(elements, byte_order="<").write(str(partial))


def _element(name: str, properties: tuple[str, ...], columns: np.ndarray) -> PlyElement:
    dtype = np.dtype([(each, columns.dtype) for each in properties])
    return PlyElement.describe(np.ascontiguousarray(columns).view(dtype).reshape(len(columns)), name)


def _rest_names(count: int) -> tuple[str, ...]:
    return tuple(f"f_rest_{index}" for index in range(count))


def _within_chunks(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(C, 6) minima and maxima of each chunk, and (N, 3) numbers rescaled to 0 to 1 between them."""
    starts = np.arange(0, len(numbers), CHUNK)
    # As float32, as in the file, so that writer and reader use the same range.
    low = np.minimum.reduceat(numbers, starts, axis=0).astype(np.float32)
    high = np.maximum.reduceat(numbers, starts, axis=0).astype(np.float32)
    chunk = np.arange(len(numbers)) // CHUNK
    extent = high.astype(np.float64) - low
    fractions = (numbers - low[chunk].astype(np.float64)) / np.where(extent > 0, extent, 1.0)[chunk]
    return np.concatenate([low, high], axis=1), fractions


def _pack(fractions: np.ndarray, fields: tuple[tuple[int, int], ...]) -> np.ndarray:
    """Pack (N, F) numbers from 0 to 1 into (N,) uint32 words."""
    words = np.zeros(len(fractions), np.uint32)
    for fraction, (bits, shift) in zip(fractions.T, fields, strict=True):
        steps = 2**bits - 1
        words |= np.clip(np.floor(fraction * steps + 0.5), 0, steps).astype(np.uint32) << shift
    return words


def _unpack(words: np.ndarray, fields: tuple[tuple[int, int], ...]) -> np.ndarray:
    """Unpack words into (N, F) numbers from 0 to 1."""
    return np.stack([(words >> shift & (2**bits - 1)) / (2**bits - 1) for bits, shift in fields], axis=1)


def read_gaussians(path: Path) -> Gaussians:
    """Read a scene.

    Raises:
        PocketGSError: the file is missing or broken, lacks a property, or its elements differ in length.
    """
    elements = read_elements(path)
    vertices = _columns(path, elements, "vertex", PACKED, "u4").T
    count = vertices.shape[1]
    rest = len(elements["sh"].dtype.names or ()) if "sh" in elements else 0
    require_room(path, count, 1 + rest // 3, READING)
    chunk = np.arange(count) // CHUNK
    expected = -(-count // CHUNK)
    if len(elements.get("chunk", ())) != expected:
        found = len(elements.get("chunk", ()))
        raise PocketGSError(f"{path}: {found} chunks, expected {expected} for {count} Gaussians")
    positions, rotations, scales, colours = vertices
    shown = _unpack(colours, FOUR_FIELDS)
    rgb = shown[:, :3]
    # Early writers stored no minima and maxima of colour: theirs are 0 and 1.
    if COLOUR[0] in (elements["chunk"].dtype.names or ()):
        rgb = _between(_columns(path, elements, "chunk", COLOUR, "f4")[chunk], rgb)
    quaternions = restore_largest(rotations >> 30, (_unpack(rotations, ROTATION_FIELDS) - 0.5) / MAX_OTHER)
    gaussians = Gaussians(
        _between(_columns(path, elements, "chunk", CENTRE, "f4")[chunk], _unpack(positions, THREE_FIELDS)),
        _between(_columns(path, elements, "chunk", SCALE, "f4")[chunk], _unpack(scales, THREE_FIELDS)),
        unit(quaternions),
        opacity_from_byte(colours & 255),
        np.concatenate([dc_of(rgb)[:, None], _harmonics(path, elements, count)], axis=1),
    )
    require_sound(path, gaussians)
    antialiased.warn_if(antialiased.is_marked(read_comments(path)), path)
    return gaussians


def _columns(
    path: Path, elements: dict[str, np.ndarray], name: str, properties: tuple[str, ...], kind: str
) -> np.ndarray:
    """(N, P) numbers of an element's properties, which must all be of one type."""
    data = elements.get(name, np.empty(0, []))
    for each in properties:
        if each not in (data.dtype.names or ()) or data.dtype[each].newbyteorder("=") != np.dtype(kind):
            raise PocketGSError(f"{path}: property {each!r} of element {name!r} is missing or not {np.dtype(kind)}")
    return np.stack([data[each].astype(kind) for each in properties], axis=1)


def _between(extremes: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    low, high = extremes[:, :3].astype(np.float64), extremes[:, 3:].astype(np.float64)
    # A bound may be infinite in a broken file; the complete scene is checked later.
    with np.errstate(invalid="ignore"):
        return low * (1.0 - fractions) + high * fractions


def _harmonics(path: Path, elements: dict[str, np.ndarray], count: int) -> np.ndarray:
    """(N, K - 1, 3) coefficients above degree 0."""
    if "sh" not in elements:
        return np.zeros((count, 0, 3))
    data = elements["sh"]
    rest = len(data.dtype.names or ())
    if len(data) != count or rest % 3 or 1 + rest // 3 not in SH_COEFFICIENTS[1:]:
        raise PocketGSError(f"{path}: sh has {len(data)} rows of {rest}, expected {count} of 9, 24 or 45")
    levels = _columns(path, elements, "sh", _rest_names(rest), "u1").astype(np.float64)
    # The outermost bytes decode to -4 and 4 exactly.
    fractions = np.where(levels == 0, 0.0, np.where(levels == SH_STEPS - 1, 1.0, (levels + 0.5) / SH_STEPS))
    return np.swapaxes(((fractions - 0.5) * SH_RANGE).reshape(count, 3, rest // 3), 1, 2)
