"""How users install what an optional extra of the package brings."""

from __future__ import annotations


def how_to_install(extra: str) -> str:
    """The commands that install an extra, for messages. They read the sources: no package index has PocketGS.

    Args:
        extra: one of `project.optional-dependencies` in pyproject.toml.
    """
    return f"in PocketGS's folder, python3 tools/bootstrap.py {extra} or pip install '.[{extra}]' adds it"
