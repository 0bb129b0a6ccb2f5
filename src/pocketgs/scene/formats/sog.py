"""PlayCanvas' SOG, version 2: attributes as lossless WebP images with one pixel per Gaussian, in a ZIP file `.sog`.

`meta.json` names the images and holds ranges and codebooks. A centre's coordinate is 16 bits of sign(x) ln(1 + |x|)
between its minimum and maximum; log scales and coefficients of degree 0 are indices into codebooks of 256 numbers; a
rotation is its three smaller components in 8 bits and the index of the largest; harmonics above degree 0 are rows of a
palette, whose numbers are indices into a codebook.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.memory_bound import JSON_BYTES, require_memory
from pocketgs.files.paths import without_here
from pocketgs.geometry.quaternions import MAX_OTHER, drop_largest, restore_largest, unit
from pocketgs.scene.formats import antialiased
from pocketgs.scene.formats.activations import opacity_from_byte, opacity_to_byte
from pocketgs.scene.formats.checks import read_contents, require_room, require_sound
from pocketgs.scene.formats.codebook_weights import codebook_weights
from pocketgs.scene.formats.codebooks import nearest, scalar_codebook, vector_codebook
from pocketgs.scene.formats.sog_archive import META, entry_named, members_of
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians
from pocketgs.scene.morton import morton_order

IMAGES = ("WEBP", "PNG")
"""Image formats that may be decoded, by Pillow's names; files from elsewhere must not choose its other decoders."""

ACROSS = 64
"""Palette entries in a row of the image of the palette."""

LARGEST = 252
"""Alpha of a rotation whose largest component is w; those of x, y and z follow."""

ENTRIES = 256
"""Numbers in a codebook."""

MAX_PALETTE, MAX_WRITTEN = 1 << 16, 1 << 12
"""Maximum palette entries: for reading, and for writing, where more take minutes."""

MAX_PIXELS = 1 << 28
MAX_TOLD = 200
"""Maximum characters of an archive's error, which may quote the file."""
# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (300, 30)


def write_gaussians(path: Path, gaussians: Gaussians) -> None:
    """Write a scene atomically, in Morton order.

    Raises:
        PocketGSError: the scene is empty or holds NaN or infinity, or the file cannot be written.
    """
    require_sound(path, gaussians)
    ordered = gaussians.select(morton_order(gaussians.means))
    count = len(ordered)
    images: dict[str, np.ndarray] = {}
    squeezed = np.sign(ordered.means) * np.log1p(np.abs(ordered.means.astype(np.float64)))
    low, high = squeezed.min(axis=0), squeezed.max(axis=0)
    fractions = (squeezed - low) / np.where(high > low, high - low, 1.0)
    steps = np.rint(fractions * 65535).astype(np.int64)
    images["means_l.webp"], images["means_u.webp"] = _picture(steps & 255), _picture(steps >> 8)
    scales, scale_rows = scalar_codebook(ordered.log_scales, ENTRIES)
    images["scales.webp"] = _picture(scale_rows)
    largest, others = drop_largest(unit(ordered.quaternions))
    turns = np.rint((others / MAX_OTHER * 0.5 + 0.5) * 255)
    images["quats.webp"] = _picture(np.concatenate([turns, largest[:, None] + LARGEST], axis=1))
    colours, colour_rows = scalar_codebook(ordered.sh[:, 0], ENTRIES)
    opacities = opacity_to_byte(ordered.opacity_logits)
    images["sh0.webp"] = _picture(np.concatenate([colour_rows, opacities[:, None]], axis=1))
    meta: dict[str, Any] = {
        "version": 2,
        "asset": {"generator": "PocketGS"},
        "count": count,
        "means": {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scales.tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": colours.tolist(), "files": ["sh0.webp"]},
    }
    if ordered.sh_degree:
        rest = ordered.sh[:, 1:].reshape(count, -1)
        palette = vector_codebook(rest, min(MAX_WRITTEN, count), codebook_weights(ordered))
        labels = nearest(rest, palette)
        codebook, rows = scalar_codebook(palette, ENTRIES)
        across = np.zeros((-(-len(rows) // ACROSS) * ACROSS, rows.shape[1]), np.int64)
        across[: len(rows)] = rows
        images["shN_centroids.webp"] = across.reshape(-1, ACROSS * rows.shape[1] // 3, 3).astype(np.uint8)
        images["shN_labels.webp"] = _picture(np.stack([labels & 255, labels >> 8, 0 * labels], axis=1))
        meta["shN"] = {
            "count": len(rows),
            "bands": ordered.sh_degree,
            "codebook": codebook.tolist(),
            "files": ["shN_centroids.webp", "shN_labels.webp"],
        }
    with replacing(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        archive.writestr(entry_named(META), json.dumps(meta))
        for name, pixels in images.items():
            archive.writestr(entry_named(name), _webp(pixels))


def _picture(rows: np.ndarray) -> np.ndarray:
    """(H, W, C) uint8 image of (N, C) rows, about square."""
    width = -(-math.isqrt(len(rows) - 1) // 4) * 4 + 4
    height = -(-len(rows) // width)
    pixels = np.zeros((height * width, rows.shape[1]), np.uint8)
    pixels[: len(rows)] = rows
    return pixels.reshape(height, width, -1)


def _webp(pixels: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    # Colours of transparent pixels matter here: alpha is data.
    Image.fromarray(pixels).save(buffer, "WEBP", lossless=True, quality=100, method=4, exact=True)
    return buffer.getvalue()


def read_gaussians(path: Path) -> Gaussians:
    """Read a scene of version 2.

    Raises:
        PocketGSError: the file is missing, broken, of another version, or exceeds the memory bound.
    """
    # Numbers beyond float32 become infinite, and are refused.
    with _opened(path) as archive, np.errstate(over="ignore", invalid="ignore"):
        gaussians = archive.scene()
    antialiased.warn_if(archive.is_antialiased, path)
    return gaussians


def is_antialiased(path: Path) -> bool:
    """Whether a file is marked as a scene that was trained with anti-aliasing.

    Raises:
        PocketGSError: as `read_gaussians`, but for the scene.
    """
    with _opened(path) as archive:
        return archive.is_antialiased


@contextmanager
def _opened(path: Path) -> Iterator[_Archive]:
    """A file while the block runs, in which the errors of archives become ours."""
    contents = read_contents(path)
    try:
        with zipfile.ZipFile(io.BytesIO(contents)) as archive:
            yield _Archive(path, archive)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, OSError, EOFError, ValueError) as error:
        raise PocketGSError(f"{path}: not a readable .sog ({str(error)[:MAX_TOLD]})") from error


class _Archive:
    """The files of a `.sog`."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self._path = path
        self._archive = archive
        self._members = members_of(archive)
        try:
            meta = json.loads(self._member(META, JSON_BYTES))
        except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
            raise PocketGSError(f"{path}: {META} is not JSON ({error})") from error
        if not isinstance(meta, dict) or meta.get("version") != 2:
            found = meta.get("version") if isinstance(meta, dict) else type(meta).__name__
            raise PocketGSError(f"{path}: {META} is of version {str(found)[:40]}, expected 2")
        self._meta: dict[str, Any] = meta

    def scene(self) -> Gaussians:
        """The scene."""
        count = self._meta.get("count")
        if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= MAX_PIXELS:
            raise PocketGSError(f"{self._path}: {str(count)[:40]} Gaussians, expected a positive integer")
        degree = self._degree()
        require_room(self._path, count, SH_COEFFICIENTS[degree], READING)
        low, high = self._numbers("means", "mins", 3), self._numbers("means", "maxs", 3)
        fine, coarse = (self._rows("means", place, count, 3) for place in (0, 1))
        fractions = (fine + 256.0 * coarse) / 65535
        squeezed = low + (high - low) * fractions
        turns = self._rows("quats", 0, count, 4)
        if turns[:, 3].min() < LARGEST:
            raise PocketGSError(
                f"{self._path}: a rotation has the alpha {turns[:, 3].min()}, expected {LARGEST} to 255"
            )
        others = (turns[:, :3] / 255.0 * 2.0 - 1.0) * MAX_OTHER
        colours = self._rows("sh0", 0, count, 4)
        sh = np.empty((count, SH_COEFFICIENTS[degree], 3), np.float32)
        sh[:, 0] = self._numbers("sh0", "codebook", ENTRIES)[colours[:, :3]]
        if degree:
            sh[:, 1:] = self._harmonics(count, degree)
        gaussians = Gaussians(
            np.sign(squeezed) * np.expm1(np.abs(squeezed)),
            self._numbers("scales", "codebook", ENTRIES)[self._rows("scales", 0, count, 3)],
            unit(restore_largest(turns[:, 3].astype(np.int64) - LARGEST, others)),
            opacity_from_byte(colours[:, 3]),
            sh,
        )
        require_sound(self._path, gaussians)
        return gaussians

    @property
    def is_antialiased(self) -> bool:
        """Whether the scene is marked as trained with anti-aliasing."""
        # The first is what splat-transform writes, the second what the specification has.
        return self._meta.get("model") == "antialiased" or self._meta.get("antialias") is True

    def _degree(self) -> int:
        if "shN" not in self._meta:
            return 0
        bands = self._field("shN", "bands")
        if bands not in (1, 2, 3) or isinstance(bands, bool):
            raise PocketGSError(f"{self._path}: shN has {str(bands)[:40]} bands, expected 1 to 3")
        return int(bands)

    def _harmonics(self, count: int, degree: int) -> np.ndarray:
        """(N, K - 1, 3) coefficients above degree 0."""
        entries, rest = self._field("shN", "count"), SH_COEFFICIENTS[degree] - 1
        if not isinstance(entries, int) or isinstance(entries, bool) or not 0 < entries <= MAX_PALETTE:
            raise PocketGSError(f"{self._path}: a palette of {str(entries)[:40]}, expected 1 to {MAX_PALETTE}")
        pixels = self._pixels("shN", 0)[..., :3]
        if pixels.shape[1] != ACROSS * rest or len(pixels) * ACROSS < entries:
            found = f"{pixels.shape[1]}x{len(pixels)} pixels"
            raise PocketGSError(f"{self._path}: the palette has {found}, expected {ACROSS * rest} by enough")
        palette = self._numbers("shN", "codebook", ENTRIES)[pixels.reshape(-1, rest, 3)[:entries]]
        low, high = self._rows("shN", 1, count, 3)[:, :2].astype(np.int64).T
        labels = low + 256 * high
        if labels.max() >= entries:
            raise PocketGSError(f"{self._path}: entry {labels.max()} of a palette of {entries}")
        return palette[labels]

    def _field(self, name: str, key: str) -> Any:
        part = self._meta.get(name)
        if not isinstance(part, dict) or key not in part:
            raise PocketGSError(f"{self._path}: {META} lacks {key!r} of {name!r}")
        return part[key]

    def _numbers(self, name: str, key: str, count: int) -> np.ndarray:
        """(count,) float64 numbers; a shorter list is padded with its last one.

        Some programs write null as a codebook's first number: it becomes what PlayCanvas' engine makes of it.
        """
        found = self._field(name, key)
        lacks_first = isinstance(found, list) and len(found) == count == ENTRIES and found[0] is None
        if lacks_first:
            found = [0.0, *found[1:]]
        is_list = isinstance(found, list) and 0 < len(found) <= count
        if not is_list or not all(isinstance(each, (int, float)) and not isinstance(each, bool) for each in found):
            raise PocketGSError(f"{self._path}: {key!r} of {name!r} is not a list of up to {count} numbers")
        try:
            numbers = np.array(found, np.float64)
        except OverflowError as error:
            raise PocketGSError(f"{self._path}: {key!r} of {name!r} holds a number beyond all bounds") from error
        if lacks_first:
            numbers[0] = numbers[1] + (numbers[1] - numbers[-1]) / (ENTRIES - 1)
        return np.concatenate([numbers, np.full(count - len(numbers), numbers[-1])])

    def _rows(self, name: str, place: int, count: int, channels: int) -> np.ndarray:
        """(N, channels) uint8 pixels of an image."""
        pixels = self._pixels(name, place)
        if pixels.shape[0] * pixels.shape[1] < count:
            found = f"{pixels.shape[1]}x{pixels.shape[0]} pixels"
            raise PocketGSError(f"{self._path}: an image of {name!r} has {found}, expected {count:,} or more")
        return pixels.reshape(-1, 4)[:count, :channels]

    def _pixels(self, name: str, place: int) -> np.ndarray:
        """(H, W, 4) uint8 image."""
        files = self._field(name, "files")
        if not isinstance(files, list) or len(files) <= place or not isinstance(files[place], str):
            raise PocketGSError(f"{self._path}: 'files' of {name!r} is not a list of {place + 1} or more names")
        try:
            with Image.open(io.BytesIO(self._member(files[place], 1)), formats=IMAGES) as image:
                require_memory(self._path, 8.0 * image.width * image.height, f"an image of {name!r}")
                return np.array(image.convert("RGBA"))
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise PocketGSError(f"{self._path}: {files[place][:80]!r} is not a readable image ({error})") from error

    def _member(self, name: str, bytes_each: int) -> bytes:
        info = self._members.get(without_here(name))
        if info is None:
            raise PocketGSError(f"{self._path}: holds no {name[:80]!r}")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            found = f"method {info.compress_type}"
            raise PocketGSError(f"{self._path}: {name[:80]!r} is compressed by {found}, expected stored or deflated")
        require_memory(self._path, bytes_each * info.file_size, f"{name[:80]!r}")
        return self._archive.read(info)
