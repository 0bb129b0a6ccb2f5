"""Files in the ZIP file of a SOG: their headers and their names."""

from __future__ import annotations

import zipfile

from pocketgs.files.paths import without_here

META = "meta.json"
ADDED = "__MACOSX/"
"""Folder that macOS adds to an archive."""

UNIX, READABLE = 3, 0o644
"""A ZIP file's number for Unix, and the permissions that files get where they are unpacked."""


def entry_named(name: str) -> zipfile.ZipInfo:
    """Header of a file, always of the same date: a scene makes the same bytes whatever the clock says."""
    entry = zipfile.ZipInfo(name)
    entry.create_system, entry.external_attr = UNIX, READABLE << 16
    return entry


def members_of(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Files by their names, from inside the folder around all of them if that was zipped with them."""
    members = {without_here(info.filename): info for info in archive.infolist()}
    if META in members:
        return members
    parts = {name: name.partition("/") for name in members if not name.startswith(ADDED)}
    if len({folder for folder, _, _ in parts.values()}) != 1:
        return members
    return {inside: members[name] for name, (_, _, inside) in parts.items()}
