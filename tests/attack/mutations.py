"""Ways to break a file: bytes, words and JSON, also where they are packed."""

from __future__ import annotations

import gzip
import json
import math
import struct
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

HOSTILE: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**31, 2**32 - 1, 2**63, -(2**63), 10**400, 1e308, -1e308, 1e-308, 0.5,
    math.nan, math.inf, -math.inf, "", " ", "x", "nan", "../../../etc/passwd", "/etc/passwd", "\0", "\x1b[2J",
    "a" * 5000,     [], {}, [[]], [None], {"a": None}, [1, 2, 3], [[1, 0], [0, 1]],
)  # fmt: skip
WORDS = (
    "",
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e400",
    "9" * 400,
    "9" * 5000,
    "4294967296",
    "x",
    "\0",
    "..",
    "/etc",
    "é",
)
NUMBERS = (
    *(struct.pack("<I", value) for value in (0, 1, 2**31 - 1, 2**31, 2**32 - 1)),
    *(struct.pack("<Q", value) for value in (0, 2**40, 2**63, 2**64 - 1)),
    *(struct.pack("<f", value) for value in (math.nan, math.inf, 1e38, -1.0, 1e-40)),
    *(struct.pack("<d", value) for value in (math.nan, -math.inf, 1e308)),
)
TEXTS = frozenset({".txt", ".csv"})


def mutated(rng: Random, name: str, content: bytes) -> bytes:
    """A broken copy of a file's content."""
    ways: list[Callable[[Random, bytes], bytes]] = [broken_bytes]
    suffix = Path(name).suffix.lower()
    if suffix in (".json", ".gltf") or name == "metadata":
        ways += [broken_json] * 4
    elif suffix in TEXTS or content[:20].startswith(b"ply\nformat ascii"):
        ways += [broken_words] * 4
    elif suffix == ".glb":
        ways += [broken_glb] * 3
    elif suffix == ".ply":
        ways += [broken_header] * 2
    elif suffix == ".pgs":
        ways += [broken_sections] * 5
    elif suffix in (".r3d", ".sog"):
        ways += [broken_archive] * 3
    elif content[:2] == b"\x1f\x8b":
        ways += [broken_gzip] * 2
    return rng.choice(ways)(rng, content)


def broken_bytes(rng: Random, content: bytes) -> bytes:
    """Flipped, overwritten, cut, repeated or exchanged bytes."""
    broken = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 40))):
        way, place = rng.randrange(7), _place(rng, len(broken))
        if way == 0 and broken:
            broken[place] ^= 1 << rng.randrange(8)
        elif way == 1 and broken:
            broken[place] = rng.choice((0, 1, 127, 128, 255))
        elif way == 2:
            number = rng.choice(NUMBERS)
            broken[place : place + len(number)] = number
        elif way == 3:
            del broken[place:]
        elif way == 4:
            del broken[place : place + rng.choice((1, 4, 100))]
        elif way == 5:
            broken[place:place] = broken[place : place + rng.choice((1, 8, 500))]
        else:
            broken[place : place + 16] = bytes(16)
    return bytes(broken)


def _place(rng: Random, length: int) -> int:
    """A random position, more often in headers."""
    return rng.randrange(max(1, min(length, rng.choice((16, 64, 400, length)))))


def broken_json(rng: Random, content: bytes) -> bytes:
    """Values exchanged, left out, or put in twice."""
    try:
        document = json.loads(content)
    except ValueError:
        return broken_bytes(rng, content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        document = _broken_value(rng, document)
    text = json.dumps(document)
    if rng.random() < 0.05:
        text = rng.choice(("[" * 100_000, text + "}", '{"a":' * 5000, text.replace("1", "1" * 5000), "\ufeff" + text))
    return text.encode("utf-8", "surrogatepass")


def _broken_value(rng: Random, value: Any) -> Any:
    if isinstance(value, dict) and value and rng.random() < 0.93:
        key = rng.choice(list(value))
        way = rng.random()
        if way < 0.08:
            return {name: each for name, each in value.items() if name != key}
        return {**value, key: _broken_value(rng, value[key])}
    if isinstance(value, list) and value and rng.random() < 0.85:
        place = rng.randrange(len(value))
        way = rng.random()
        if way < 0.08:
            return value[:place] + value[place + 1 :]
        if way < 0.14:
            return [*value, value[place]]
        return [*value[:place], _broken_value(rng, value[place]), *value[place + 1 :]]
    if isinstance(value, int | float) and not isinstance(value, bool) and rng.random() < 0.4:
        return rng.choice((-value, value * 1000, value + 1, value // 2, str(value)))
    return rng.choice(HOSTILE)


def broken_words(rng: Random, content: bytes) -> bytes:
    """Words of a text exchanged, and lines left out or repeated."""
    lines = content.decode("utf-8", "replace").split("\n")
    for _ in range(rng.choice((1, 1, 3))):
        place = rng.randrange(len(lines))
        way = rng.random()
        if way < 0.1:
            del lines[place]
            lines = lines or [""]
        elif way < 0.2:
            lines.insert(place, lines[place])
        else:
            separator = "," if "," in lines[place] else " "
            words = lines[place].split(separator)
            words[rng.randrange(len(words))] = rng.choice(WORDS)
            lines[place] = separator.join(words)
    return "\n".join(lines).encode()


def broken_header(rng: Random, content: bytes) -> bytes:
    """The words of a binary .ply's header."""
    head, end, rest = content.partition(b"end_header\n")
    return broken_words(rng, head) + end + rest


def broken_glb(rng: Random, content: bytes) -> bytes:
    """The JSON inside, packed again with right lengths."""
    size = struct.unpack_from("<I", content, 12)[0]
    text, rest = broken_json(rng, content[20 : 20 + size]), content[20 + size :]
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def broken_gzip(rng: Random, content: bytes) -> bytes:
    """Break the content, and compress it again with a correct checksum."""
    return gzip.compress(broken_bytes(rng, gzip.decompress(content)), 1)


def broken_sections(rng: Random, content: bytes) -> bytes:
    """A .pgs that is broken behind a checksum and sizes that are right."""
    count = struct.unpack_from("<H", content, 6)[0]
    rows = [bytearray(content[12 + 16 * index : 28 + 16 * index]) for index in range(count)]
    parts, start = [], 12 + 16 * count
    for row in rows:
        size = struct.unpack_from("<I", row, 12)[0]
        parts.append(content[start : start + size])
        start += size
    for _ in range(rng.choice((1, 1, 2))):
        place, way = rng.randrange(count), rng.random()
        if way < 0.1:
            row, part = rows.pop(place), parts.pop(place)
            if way < 0.05:
                rows += [row, row]
                parts += [part, part]
            count = len(rows)
        elif way < 0.2:
            rows[place][:12] = broken_bytes(rng, bytes(rows[place][:12]))[:12].ljust(12, b"\0")
        else:
            parts[place] = broken_bytes(rng, parts[place])
    for row, part in zip(rows, parts, strict=True):
        row[12:] = struct.pack("<I", len(part))
    body = b"".join([*map(bytes, rows), *parts])
    return content[:6] + struct.pack("<HI", len(rows), zlib.crc32(body)) + body


def broken_archive(rng: Random, content: bytes) -> bytes:
    """A file of an archive, or an archive with a file missing or duplicated."""
    import io
    import warnings

    source, target = zipfile.ZipFile(io.BytesIO(content)), io.BytesIO()
    chosen, way = rng.choice(source.namelist()), rng.random()
    with warnings.catch_warnings(), zipfile.ZipFile(target, "w") as archive:
        warnings.simplefilter("ignore")
        for name in source.namelist():
            inside = source.read(name)
            if name == chosen:
                if way < 0.1:
                    continue
                inside = mutated(rng, name.rpartition("/")[2], inside)
            archive.writestr(name, inside, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))
            if name == chosen and way > 0.95:
                archive.writestr(name, inside)
    return target.getvalue()


def break_tree(rng: Random, folder: Path, file: Path) -> None:
    """Something else than a file's content: the file is gone, empty, a folder, another file or a link."""
    way = rng.randrange(6)
    others = sorted(path for path in folder.rglob("*") if path.is_file() and path != file)
    with suppress(OSError):
        file.unlink()
        if way == 1:
            file.write_bytes(b"")
        elif way == 2:
            file.mkdir()
        elif way == 3 and others:
            file.write_bytes(rng.choice(others).read_bytes())
        elif way == 4:
            file.symlink_to(rng.choice(("/etc/passwd", file, file.parent, "/dev/zero", file.with_name("nowhere"))))
        elif way == 5:
            file.rename(file.with_name(f"\x1b[2J{file.name}"))
