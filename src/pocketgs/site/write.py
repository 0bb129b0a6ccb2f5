"""Writing the site to a folder."""

from __future__ import annotations

from pathlib import Path

from pocketgs.results.claim import claimed
from pocketgs.site.files import site_files

OUTDATED = ("train/*", "train/*/*", "train/*/*/*", "page/*", "page/*/*", "gpu/*")
"""Files of an earlier site, in whatever folder these folders are: each version has its own."""


def write_site(folder: Path) -> dict[str, int]:
    """Write the site, all of it or nothing. Of the folder's files, only those of an earlier site are replaced.

    Args:
        folder: created if needed.

    Returns:
        The size of every file in bytes, by its path in the folder.

    Raises:
        PocketGSError: the folder cannot be written to, or a file that PocketGS did not write is in the way.
    """
    files = site_files()
    with claimed(folder, files) as claim, claim.publishing(files, OUTDATED) as staging:
        for name, content in files.items():
            path = staging / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    return {name: len(content) for name, content in files.items()}
