"""glTF containers: `.glb`, with JSON and bytes in one file, and `.gltf`, with embedded or separate buffers."""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from pocketgs.errors import PocketGSError, clipped, short
from pocketgs.files.memory_bound import JSON_BYTES, require_memory
from pocketgs.files.opening import reading_inside
from pocketgs.files.paths import inside
from pocketgs.scene.formats.checks import read_contents

GLB_MAGIC, GLB_VERSION = b"glTF", 2
GLB_HEADER, CHUNK_HEADER = struct.Struct("<4sII"), struct.Struct("<I4s")
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
ALIGNMENT = 4
MAX_FILE_BYTES = 2**32 - 1


@dataclass(frozen=True)
class Document:
    """A glTF asset: its JSON and the bytes of its buffers."""

    path: Path
    json: dict[str, Any]
    buffers: list[memoryview]


def read_document(path: Path) -> Document:
    """Read a `.glb` or `.gltf` with its buffers.

    Raises:
        PocketGSError: a file is missing, broken or cut short, or a buffer lies outside the file's folder.
    """
    whole = read_contents(path)
    text, binary = _chunks(path, whole) if whole.startswith(GLB_MAGIC) else (whole, None)
    require_memory(path, JSON_BYTES * len(text), f"JSON of {len(text):,} bytes")
    try:
        document = dict(json.loads(text.decode("utf-8")))
    except (ValueError, TypeError, RecursionError) as error:
        raise PocketGSError(f"{path}: not a glTF: its JSON cannot be read ({clipped(error)})") from error
    stated = document.get("buffers", [])
    if not isinstance(stated, list) or not all(isinstance(each, dict) for each in stated):
        raise PocketGSError(f"{path}: buffers are not a list of objects, expected glTF 2.0")
    contents: dict[str, bytes] = {}
    buffers = [_buffer(path, index, each, binary, contents) for index, each in enumerate(stated)]
    require_memory(path, sum(map(len, contents.values())), "its buffers")
    return Document(path, document, buffers)


def _chunks(path: Path, contents: bytes) -> tuple[bytes, bytes | None]:
    """The JSON of a `.glb`, and its binary chunk if it has one."""
    if len(contents) < GLB_HEADER.size:
        raise PocketGSError(f"{path}: cut short: {len(contents)} bytes of a header of {GLB_HEADER.size}")
    _, version, length = GLB_HEADER.unpack_from(contents)
    if version != GLB_VERSION:
        raise PocketGSError(f"{path}: version {version} of GLB, expected {GLB_VERSION}")
    if length > len(contents):
        raise PocketGSError(f"{path}: cut short: {len(contents)} bytes, but its header states {length}")
    chunks: list[tuple[bytes, bytes]] = []
    start = GLB_HEADER.size
    while start + CHUNK_HEADER.size <= length and len(chunks) < 2:
        size, kind = CHUNK_HEADER.unpack_from(contents, start)
        start += CHUNK_HEADER.size
        if start + size > length:
            raise PocketGSError(f"{path}: cut short: chunk {kind!r} of {size} bytes passes the end at {length}")
        chunks.append((kind, contents[start : start + size]))
        start += size
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise PocketGSError(f"{path}: its first chunk is not JSON")
    return chunks[0][1], next((data for kind, data in chunks[1:] if kind == BINARY_CHUNK), None)


def _buffer(
    path: Path, index: int, stated: dict[str, Any], binary: bytes | None, contents: dict[str, bytes]
) -> memoryview:
    """The bytes of a buffer, without a copy: many buffers may share a file.

    Args:
        path: the asset.
        index: of the buffer.
        stated: the buffer's entry in the JSON.
        binary: the binary chunk of a `.glb`.
        contents: files read so far, by URI; this one is added.
    """
    where, uri, length = f"{path}, buffer {index}", stated.get("uri"), stated.get("byteLength")
    if not isinstance(length, int) or length < 0:
        raise PocketGSError(f"{where}: byteLength {short(length)}, expected a number of bytes")
    if uri is None and index == 0 and binary is not None:
        data = binary
    elif not isinstance(uri, str):
        raise PocketGSError(f"{where}: uri {short(uri)}, expected a file or a data URI")
    else:
        data = contents[uri] if uri in contents else _content(path, uri, where)
        contents[uri] = data
    if len(data) < length:
        raise PocketGSError(f"{where}: cut short: {len(data)} bytes, expected {short(length)}")
    return memoryview(data)[:length]


def _content(path: Path, uri: str, where: str) -> bytes:
    """Read a URI: a file beside the asset, or embedded data."""
    if uri.startswith("data:"):
        return _embedded(where, uri)
    with reading_inside(path.parent):
        return read_contents(inside(path.parent, unquote(uri), where))


def _embedded(where: str, uri: str) -> bytes:
    kind, comma, data = uri.partition(",")
    if not comma or not kind.endswith(";base64"):
        raise PocketGSError(f"{where}: data URI begins {uri[:40]!r}, expected base64")
    try:
        return base64.b64decode(unquote(data), validate=True)
    except ValueError as error:
        raise PocketGSError(f"{where}: its base64 cannot be decoded ({clipped(error)})") from error


def glb_bytes(path: Path, document: dict[str, Any], binary: bytes) -> bytes:
    """Encode a `.glb` with one buffer, `binary`.

    Raises:
        PocketGSError: it would exceed the format's maximum size.
    """
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    binary += b"\0" * (-len(binary) % ALIGNMENT)
    length = GLB_HEADER.size + 2 * CHUNK_HEADER.size + len(text) + len(binary)
    if length > MAX_FILE_BYTES:
        raise PocketGSError(f"{path}: would take {length} bytes, but a .glb can hold {MAX_FILE_BYTES}")
    parts = [GLB_HEADER.pack(GLB_MAGIC, GLB_VERSION, length), CHUNK_HEADER.pack(len(text), JSON_CHUNK), text]
    return b"".join([*parts, CHUNK_HEADER.pack(len(binary), BINARY_CHUNK), binary])
