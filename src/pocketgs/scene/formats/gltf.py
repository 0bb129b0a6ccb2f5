"""glTF with the extension `KHR_gaussian_splatting`: standard deviations and opacities as floats.

Gaussians are a point primitive whose attributes the extension names. glTF's axes are x left, y up, z forward. We write
one mesh without a transform, and read every node that shows Gaussians, with its transform.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError, clipped, short
from pocketgs.files.atomic_file import replacing
from pocketgs.geometry.quaternions import unit
from pocketgs.scene.edits import with_sh_degree
from pocketgs.scene.formats.activations import colour_of, logit_of, opacity_of, opacity_to_byte, to_byte
from pocketgs.scene.formats.axes import LEFT_UP_FORWARD, half_turn
from pocketgs.scene.formats.checks import require_room, require_sound
from pocketgs.scene.formats.gltf_accessors import item, read_accessor, whole_number
from pocketgs.scene.formats.gltf_document import Document, glb_bytes, read_document
from pocketgs.scene.formats.gltf_placements import Placement, placed, placements
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians, concatenate

EXTENSION = "KHR_gaussian_splatting"
KERNEL, COLOUR_SPACE = "ellipse", "srgb_rec709_display"
POINTS, ARRAY_BUFFER = 0, 34962
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
FLOAT, UNSIGNED_BYTE = 5126, 5121
MIN_SCALE, MAX_SCALE = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
MAX_PARTS = 4096
"""Maximum number of primitives and nodes that show Gaussians; each takes about a millisecond."""

# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (360, 48)

OPACITY_MARGIN = 2.0**-25
"""Half of the gap between 1 and the largest float32 below it."""


def write_gaussians(path: Path, gaussians: Gaussians) -> None:
    """Write a scene atomically as a `.glb`, with vertex colours for programs that draw plain points.

    Raises:
        PocketGSError: the scene is empty or holds NaN or infinity, or the file cannot be written.
    """
    if path.suffix.lower() != ".glb":
        raise PocketGSError(f"{path}: cannot be written, expected a name that ends in .glb")
    require_sound(path, gaussians)
    columns = _columns(half_turn(gaussians, LEFT_UP_FORWARD))
    attributes = dict(zip(columns, range(len(columns)), strict=True))
    views, accessors, start = [], [], 0
    for index, column in enumerate(columns.values()):
        views.append({"buffer": 0, "byteOffset": start, "byteLength": column.nbytes, "target": ARRAY_BUFFER})
        accessors.append(_accessor(index, column))
        start += column.nbytes
    accessors[0]["min"] = columns["POSITION"].min(axis=0).tolist()
    accessors[0]["max"] = columns["POSITION"].max(axis=0).tolist()
    shape = {EXTENSION: {"kernel": KERNEL, "colorSpace": COLOUR_SPACE}}
    document = {
        "asset": {"version": "2.0", "generator": "PocketGS"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "mode": POINTS, "extensions": shape}]}],
        "buffers": [{"byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }
    contents = glb_bytes(path, document, b"".join(column.tobytes() for column in columns.values()))
    with replacing(path) as partial:
        partial.write_bytes(contents)


def _columns(gaussians: Gaussians) -> dict[str, np.ndarray]:
    """The attributes, with one row per Gaussian; the first is POSITION."""
    with np.errstate(over="ignore"):
        scales = np.clip(gaussians.scales, MIN_SCALE, MAX_SCALE)
    shown = [to_byte(colour_of(gaussians.sh[:, 0]) * 255), opacity_to_byte(gaussians.opacity_logits)[:, None]]
    columns = {
        "POSITION": gaussians.means,
        "COLOR_0": np.concatenate(shown, axis=1),
        f"{EXTENSION}:ROTATION": np.roll(unit(gaussians.quaternions), -1, axis=1).astype("<f4"),
        f"{EXTENSION}:SCALE": scales.astype("<f4"),
        f"{EXTENSION}:OPACITY": opacity_of(gaussians.opacity_logits).astype("<f4")[:, None],
    }
    harmonics = zip(_harmonic_names(gaussians.sh_degree), np.swapaxes(gaussians.sh, 0, 1), strict=True)
    return columns | {name: coefficients.astype("<f4") for name, coefficients in harmonics}


def _accessor(view: int, column: np.ndarray) -> dict[str, Any]:
    shape = {"bufferView": view, "count": len(column), "type": TYPES[column.shape[1]]}
    if column.dtype == np.uint8:
        return {**shape, "componentType": UNSIGNED_BYTE, "normalized": True}
    return {**shape, "componentType": FLOAT}


def _harmonic_names(degree: int) -> list[str]:
    return [f"{EXTENSION}:SH_DEGREE_{d}_COEF_{n}" for d in range(degree + 1) for n in range(2 * d + 1)]


def read_gaussians(path: Path) -> Gaussians:
    """Read all Gaussians of a `.glb` or `.gltf` as one scene.

    Raises:
        PocketGSError: a file is missing, broken or cut short, has no Gaussians, or uses a feature that is not
            supported: compressed buffers, another kernel or colour space, or a node that stretches or shears.
    """
    document = read_document(path)
    # NaN and infinity are checked later, on the complete scene.
    with np.errstate(all="ignore"):
        try:
            parts = _parts(document)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
            raise PocketGSError(f"{path}: not a valid glTF ({type(error).__name__}: {clipped(error)})") from error
        if not parts:
            raise PocketGSError(f"{path}: shows no Gaussians, expected a primitive with {EXTENSION}")
        degree = max(part.sh_degree for part in parts)
        gaussians = half_turn(concatenate([with_sh_degree(part, degree) for part in parts]), LEFT_UP_FORWARD)
    require_sound(path, gaussians)
    return gaussians


def _parts(document: Document) -> list[Gaussians]:
    unknown = set(document.json.get("extensionsRequired", [])) - {EXTENSION, "KHR_mesh_quantization"}
    if unknown:
        raise PocketGSError(f"{document.path}: requires {clipped(', '.join(sorted(unknown)))}, which is not supported")
    shown = _shown(document)
    # Nodes may share a mesh, and accessors may share bytes, but a small file must not expand to a huge scene.
    counts = [_count(document, primitive) for primitive, _ in shown]
    coefficients = max(map(_coefficients, (primitive for primitive, _ in shown)), default=0)
    if sum(counts) > sum(map(len, document.buffers)):
        raise PocketGSError(f"{document.path}: shows more Gaussians than it has bytes")
    require_room(document.path, sum(counts), coefficients, READING)
    return [_part(document, primitive, placement) for primitive, placement in shown]


def _shown(document: Document) -> list[tuple[dict[str, Any], Placement]]:
    """The primitives that are Gaussians, once per node that shows them."""
    shown: list[tuple[dict[str, Any], Placement]] = []
    for placement in placements(document):
        for primitive in item(document, "meshes", placement.mesh)["primitives"]:
            if EXTENSION in primitive.get("extensions", {}):
                shown.append((primitive, placement))
                if len(shown) > MAX_PARTS:
                    raise PocketGSError(f"{document.path}: shows more than {MAX_PARTS} groups of Gaussians")
    return shown


def _count(document: Document, primitive: dict[str, Any]) -> int:
    """Number of Gaussians that a primitive states."""
    if _coefficients(primitive) not in SH_COEFFICIENTS:
        stated = f"{_coefficients(primitive)} coefficients of spherical harmonics"
        raise PocketGSError(f"{document.path}: {stated}, expected 1, 4, 9 or 16")
    return whole_number(item(document, "accessors", primitive["attributes"]["POSITION"]).get("count"), "count")


def _coefficients(primitive: dict[str, Any]) -> int:
    """Number of spherical-harmonics coefficients that a primitive states."""
    return sum(name.startswith(f"{EXTENSION}:SH_DEGREE_") for name in primitive["attributes"])


def _part(document: Document, primitive: dict[str, Any], placement: Placement) -> Gaussians:
    """The Gaussians of one primitive with its node's transform, still in glTF's axes."""
    where, attributes, shape = document.path, primitive["attributes"], primitive["extensions"][EXTENSION]
    if "extensions" in shape:
        raise PocketGSError(f"{where}: uses {clipped(', '.join(shape['extensions']))}, expected plain attributes")
    if shape.get("kernel", KERNEL) != KERNEL or shape.get("colorSpace", COLOUR_SPACE) != COLOUR_SPACE:
        found = f"kernel {short(shape.get('kernel'))} in {short(shape.get('colorSpace'))}"
        raise PocketGSError(f"{where}: {found}, expected {KERNEL!r} in {COLOUR_SPACE!r}")
    count = _coefficients(primitive)
    scales = read_accessor(document, attributes[f"{EXTENSION}:SCALE"], 3)
    if np.any(scales < 0):
        raise PocketGSError(f"{where}: negative scales, expected standard deviations; early drafts had logarithms")
    names = _harmonic_names(SH_COEFFICIENTS.index(count))
    means = read_accessor(document, attributes["POSITION"], 3)
    rotations = read_accessor(document, attributes[f"{EXTENSION}:ROTATION"], 4)
    opacities = read_accessor(document, attributes[f"{EXTENSION}:OPACITY"], 1)
    harmonics = [read_accessor(document, attributes[name], 3) for name in names]
    lengths = {len(column) for column in (means, scales, rotations, opacities, *harmonics)}
    if len(lengths) > 1:
        raise PocketGSError(f"{where}: attributes of {sorted(lengths)} Gaussians, expected the same number in each")
    gaussians = Gaussians(
        means,
        np.log(np.maximum(scales, MIN_SCALE)),
        unit(np.roll(rotations, 1, axis=1)),
        logit_of(opacities[:, 0], OPACITY_MARGIN),
        np.stack(harmonics, axis=1),
    )
    return placed(gaussians, placement)
