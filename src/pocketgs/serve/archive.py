"""Unpacking an uploaded zip file. Its names become names on disk, so only plain ones are taken."""

from __future__ import annotations

import re
import shutil
import stat
import unicodedata
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

from pocketgs.errors import PocketGSError, short
from pocketgs.files.paths import without_here
from pocketgs.serve.shelf import free_bytes

MAX_FILES = 50_000
MAX_DEPTH = 12
MAX_NAME_BYTES = 200

_RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
"""Names that are devices on Windows, with any suffix."""

_FORBIDDEN = re.compile(r'[<>:"|?*\\\x00-\x1f\x7f]')
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What phones and computers write. Others, such as LZMA, take as much memory to unpack as the file states."""

_IS_UTF8 = 1 << 11
"""The flag of names in UTF-8. Many programs write these without it."""

_LEFT_OUT = ("__MACOSX", ".DS_Store", "Thumbs.db")


def unpack(archive: Path, folder: Path, max_bytes: int) -> None:
    """Unpack a zip file into a folder.

    Args:
        archive: the file.
        folder: to create.
        max_bytes: bound of the sizes of all files together; a file never unpacks to more than the archive states.

    Raises:
        PocketGSError: it is no whole zip file; it unpacks to too much, or to more than the disk has room for; it holds
            what is not stored or deflated; its names are not plain: absolute ones, ones with `..`, links, names that
            some system reserves or cannot tell apart.
        OSError: it cannot be written.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = _checked(opened, max_bytes, free_bytes(folder.parent))
            folder.mkdir()
            for member in members:
                path = folder.joinpath(*member.filename.split("/"))
                _make_parents(path, folder)
                with opened.open(member) as packed, path.open("xb") as file:
                    shutil.copyfileobj(packed, file)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise PocketGSError(f"is no whole zip file ({short(str(error))})") from error
    except (FileExistsError, NotADirectoryError) as error:
        raise PocketGSError("holds a file and a folder of the same name") from error


def _make_parents(path: Path, folder: Path) -> None:
    """Make the folders between a file and the folder above, but never that one: it may have been moved to the trash."""
    for parent in reversed(path.relative_to(folder).parents[:-1]):
        (folder / parent).mkdir(exist_ok=True)


def _checked(opened: zipfile.ZipFile, max_bytes: int, free: int) -> list[zipfile.ZipInfo]:
    _name(opened.infolist())
    members = [
        member
        for member in opened.infolist()
        if not member.filename.endswith("/") and not any(part in _LEFT_OUT for part in member.filename.split("/"))
    ]
    if len(members) > MAX_FILES:
        raise PocketGSError(f"holds {len(members):,} files, expected at most {MAX_FILES:,}")
    total = sum(member.file_size for member in members)
    if total > max_bytes:
        raise PocketGSError(f"unpacks to {total / 1e6:,.0f} MB, expected at most {max_bytes / 1e6:,.0f} MB")
    if total > free:
        raise PocketGSError(f"unpacks to {total / 1e6:,.0f} MB, and the disk has room for {max(0, free) / 1e6:,.0f} MB")
    known: set[str] = set()
    for member in members:
        _check(member)
        # Some file systems take these for the same.
        plain = unicodedata.normalize("NFC", member.filename).casefold()
        if plain in known:
            raise PocketGSError(f"holds {short(member.filename)} twice")
        known.add(plain)
    return members


def _name(members: list[zipfile.ZipInfo]) -> None:
    """Give members the names that were meant, where programs write others than the format asks for."""
    for member in members:
        if not member.flag_bits & _IS_UTF8:
            with suppress(UnicodeError):  # then they are what the format says: code page 437
                member.filename = member.filename.encode("cp437").decode("utf-8")
    if not any("/" in member.filename for member in members):
        for member in members:  # an old program on Windows: it separates folders by backslashes
            member.filename = member.filename.replace("\\", "/")
    for member in members:
        member.filename = without_here(member.filename)


def _check(member: zipfile.ZipInfo) -> None:
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind not in (0, stat.S_IFREG):
        raise PocketGSError(f"holds {short(member.filename)}, which is a link or a device: expected files only")
    if member.flag_bits & 1:
        raise PocketGSError("is encrypted, expected a zip file without a password")
    if member.compress_type not in _METHODS:
        raise PocketGSError(
            f"holds {short(member.filename)}, compressed by method {member.compress_type}: "
            "expected files that are stored or deflated"
        )
    parts = member.filename.split("/")
    if len(parts) > MAX_DEPTH or not all(_is_plain(part) for part in parts):
        raise PocketGSError(f"holds {short(member.filename)}, expected names that every system can keep")


def _is_plain(part: str) -> bool:
    try:
        length = len(part.encode())
    except UnicodeEncodeError:
        return False
    is_odd = part in ("", ".", "..") or part[-1] in ". " or _FORBIDDEN.search(part) or _RESERVED.fullmatch(part)
    return length <= MAX_NAME_BYTES and not is_odd
