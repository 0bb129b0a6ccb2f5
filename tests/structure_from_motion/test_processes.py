"""The modules in `colmap/` run in processes of their own: what they share with the program that starts them."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pocketgs.structure_from_motion

HERE = "pocketgs.structure_from_motion"
PARENT = Path(pocketgs.structure_from_motion.__file__).parent
IN_CHILDREN = sorted((PARENT / "colmap").glob("*.py"))
IN_PARENT = sorted(PARENT.glob("*.py"))

LOADED = """
import sys
from importlib import import_module
for name in sys.argv[2:]:
    import_module(name)
sys.exit(sys.argv[1] in sys.modules)
"""
"""Whether importing modules loads one that they must not."""


def imported(path: Path) -> set[str]:
    """The modules that a module imports, wherever it does so."""
    found = set()
    for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(statement, ast.Import):
            found |= {name.name for name in statement.names}
        elif isinstance(statement, ast.ImportFrom) and statement.module:
            found.add(statement.module)
    return found


def loads(paths: Iterable[Path], forbidden: str) -> bool:
    """Whether the modules load another one, directly or not."""
    names = [".".join((HERE, *path.relative_to(PARENT).with_suffix("").parts)) for path in paths]
    found = subprocess.run([sys.executable, "-c", LOADED, forbidden, *names], capture_output=True, text=True)
    assert found.stderr == ""
    return found.returncode == 1


def test_child_processes_import_only_geometry_of_the_rest() -> None:
    assert "verify_and_map.py" in {path.name for path in IN_CHILDREN}
    for path in IN_CHILDREN:
        ours = {name for name in imported(path) if name.startswith("pocketgs")}
        assert all(name.startswith((f"{HERE}.colmap.", "pocketgs.geometry.")) for name in ours), path.name


def test_the_program_that_starts_them_imports_only_descriptions_of_jobs() -> None:
    descriptions = {path for path in IN_CHILDREN if path.stem.endswith("_job")}
    for path in IN_PARENT:
        theirs = {name for name in imported(path) if name.startswith(f"{HERE}.colmap")}
        assert theirs <= {f"{HERE}.colmap.{description.stem}" for description in descriptions}, path.name
    for path in [*IN_PARENT, *descriptions]:
        assert "pycolmap" not in imported(path), path.name
    assert not loads([path for path in IN_PARENT if path.stem != "__init__"], "pycolmap")


def test_child_processes_load_no_pillow() -> None:
    """Not by way of geometry either."""
    assert not loads([path for path in IN_CHILDREN if path.stem != "__init__"], "PIL")
