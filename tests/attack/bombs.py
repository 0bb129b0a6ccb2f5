"""Small files that state, or decompress to, huge sizes; built without allocating these."""

from __future__ import annotations

import json
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MEGABYTE = bytes(1 << 20)
GZIP, ZLIB = 31, 15


def deflated(size: int, wbits: int, start: bytes = b"") -> bytes:
    """`start` and then zeros, `size` bytes in all, compressed piece by piece."""
    compressor = zlib.compressobj(1, wbits=wbits)
    parts = [compressor.compress(start)]
    for left in range(size - len(start), 0, -len(MEGABYTE)):
        parts.append(compressor.compress(MEGABYTE[:left]))
    return b"".join([*parts, compressor.flush()])


def spz_gzip(path: Path, count: int) -> Path:
    """An .spz of version 3 with spherical harmonics of degree 3."""
    header = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 3, 12, 0, 0)
    path.write_bytes(deflated(len(header) + 65 * count, GZIP, header))
    return path


def spz_zstd(path: Path, count: int) -> Path:
    """An .spz of version 4 without spherical harmonics above degree 0."""
    sizes = [9 * count, count, 3 * count, 3 * count, 4 * count]
    streams = []
    for size in sizes:
        compressor = zstd.ZstdCompressor()
        parts = [compressor.compress(MEGABYTE[:left]) for left in range(size, 0, -len(MEGABYTE))]
        streams.append(b"".join([*parts, compressor.flush()]))
    header = struct.pack("<4sIIBBBBI12x", b"NGSP", 4, count, 0, 12, 0, len(sizes), 32)
    table = b"".join(struct.pack("<QQ", len(packed), size) for packed, size in zip(streams, sizes, strict=True))
    path.write_bytes(b"".join([header, table, *streams]))
    return path


def _gltf(buffers: list[dict[str, Any]], count: int, primitives: int) -> dict[str, Any]:
    extension = "KHR_gaussian_splatting"
    names = {"POSITION": "VEC3", f"{extension}:ROTATION": "VEC4", f"{extension}:SCALE": "VEC3"}
    names |= {f"{extension}:OPACITY": "SCALAR", f"{extension}:SH_DEGREE_0_COEF_0": "VEC3"}
    accessors = [{"bufferView": 0, "count": count, "type": kind, "componentType": 5126} for kind in names.values()]
    primitive = {
        "attributes": dict(zip(names, range(len(names)), strict=True)),
        "mode": 0,
        "extensions": {extension: {}},
    }
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive] * primitives}],
        "buffers": buffers,
        "bufferViews": [{"buffer": 0, "byteLength": buffers[0]["byteLength"]}],
        "accessors": accessors,
    }


def gltf_shared_view(path: Path, count: int, primitives: int) -> Path:
    """Many primitives of which each shows the same bytes."""
    path.with_suffix(".bin").write_bytes(bytes(16 * count))
    buffer = {"uri": path.with_suffix(".bin").name, "byteLength": 16 * count}
    path.write_text(json.dumps(_gltf([buffer], count, primitives)))
    return path


def gltf_named_often(path: Path, size: int, times: int) -> Path:
    """Many buffers that refer to one file."""
    path.with_suffix(".bin").write_bytes(bytes(size))
    buffers = [{"uri": path.with_suffix(".bin").name, "byteLength": size - index} for index in range(times)]
    path.write_text(json.dumps(_gltf(buffers, size // 16, 1)))
    return path


def gltf_many_nodes(path: Path, nodes: int) -> Path:
    """Nodes of which each turns the same mesh its own way."""
    path.with_suffix(".bin").write_bytes(bytes(16 * nodes))
    document = _gltf([{"uri": path.with_suffix(".bin").name, "byteLength": 16 * nodes}], 1, 1)
    document["nodes"] = [{"mesh": 0, "translation": [index, 0, 0]} for index in range(nodes)]
    document["scenes"] = [{"nodes": list(range(nodes))}]
    path.write_text(json.dumps(document))
    return path


def r3d_metadata(path: Path, size: int) -> Path:
    """A recording whose metadata unpack to any size."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("metadata", "w") as file:
        file.write(b'{"w": 1, "poses": [')
        for left in range(size, 0, -len(MEGABYTE)):
            file.write(b" " * min(left, len(MEGABYTE)))
        file.write(b"]}")
    return path


def png(path: Path, width: int, height: int) -> Path:
    """A black picture of 8-bit colours."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = deflated(height * (3 * width + 1), ZLIB)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b""))
    return path


def capture_of(folder: Path, images: list[Path], width: int, height: int) -> Path:
    """A capture as nerfstudio writes it, of images in the folder."""
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    frames = [{"file_path": image.name, "transform_matrix": pose} for image in images]
    document = {"fl_x": width, "w": width, "h": height, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder
