"""`pocketgs site`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.cli.terminal import Terminal
from pocketgs.site.write import write_site


def site(folder: Annotated[Path, tyro.conf.Positional]) -> None:
    """Write a static site that trains captures in the browser: any https host serves it, and nothing is uploaded.

    Args:
        folder: Folder for the site. Files that PocketGS did not write are never replaced.
    """
    sizes = write_site(folder)
    Terminal().say(f"{len(sizes)} files, {sum(sizes.values()) / 1000:,.0f} kB in {folder}")
