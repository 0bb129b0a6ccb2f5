"""Every module can be imported, without circles, and folders import only those that they may."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pocketgs

SOURCES = Path(pocketgs.__file__).parents[1]
MODULES = sorted(
    ".".join(path.relative_to(SOURCES).with_suffix("").parts).removesuffix(".__init__")
    for path in Path(pocketgs.__file__).parent.rglob("*.py")
    if path.name != "__main__.py"
)
"""Found without importing any, since tests are collected by processes whose memory is measured."""

IMPORT_ALL = """
import sys
from importlib import import_module
for name in sys.argv[1:]:
    try:
        import_module(name)
    except ModuleNotFoundError as error:
        if error.name.startswith("pocketgs"):
            raise
"""
"""Imports all modules that it is given; those whose optional packages are not installed need not load."""


def imported(path: Path) -> Iterator[str]:
    """The modules of ours that a module imports at any time, and not only for type hints."""
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            waiting += node.orelse
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)
        else:
            waiting += ast.iter_child_nodes(node)


MAY_IMPORT_BACK = {"pocketgs.scene.gaussians": "pocketgs.scene.formats"}
"""Imports inside functions that close a circle: `Gaussians.save` and `load` need the formats, which make Gaussians."""


def test_no_module_imports_itself_by_a_detour() -> None:
    """Imports inside functions count too, since they would only hide a circle.

    Importing a module counts as importing its package, except from inside the package.
    """
    root = Path(pocketgs.__file__).parent
    needs: dict[str, set[str]] = {}
    for path in root.rglob("*.py"):
        name = ".".join(("pocketgs", *path.relative_to(root).with_suffix("").parts)).removesuffix(".__init__")
        found = set(imported(path))
        packages = {each.rpartition(".")[0] for each in found}
        needs[name] = {each for each in found | packages if not f"{name}.".startswith(f"{each}.")}
    for name, back in MAY_IMPORT_BACK.items():
        needs[name].remove(back)
    TopologicalSorter({name: needs[name] & set(needs) - {"pocketgs"} for name in needs}).prepare()


def test_every_module_can_be_imported() -> None:
    """In one process: since there are no circles, the order does not matter."""
    assert "pocketgs.scene.edits" in MODULES
    found = subprocess.run([sys.executable, "-c", IMPORT_ALL, *MODULES], capture_output=True, text=True)
    assert (found.stdout, found.stderr, found.returncode) == ("", "", 0)


FOLDERS = {
    "errors": "",
    "extras": "",
    "system": "",
    "files": "errors system",
    "geometry": "errors",
    "scene": "errors files geometry system",
    "gpu": "errors",
    "capture": "errors files geometry scene system",
    "structure_from_motion": "capture errors files geometry scene system",
    "prior": "capture errors geometry gpu scene system",
    "splat": "capture errors geometry gpu scene system",
    "seeding": "errors gpu scene system",
    "torch": "errors extras geometry scene splat system",
    "metrics": "errors extras splat",
    "training": "capture errors geometry metrics prior scene seeding splat structure_from_motion system",
    "compression": "capture errors geometry metrics scene splat system training",
    "sort_free": "capture errors files geometry scene splat system training",
    "results": "capture errors files geometry metrics prior scene splat system training",
    "viewer": "capture errors files geometry gpu results scene splat system training",
    "site": "capture compression errors files geometry gpu prior results scene seeding splat training viewer",
    "serve": "capture errors files results scene site viewer",
    "benchmark": "capture errors extras files results scene system training",
    "cli": "benchmark capture compression errors files geometry gpu metrics prior results scene serve site sort_free"
    " splat structure_from_motion system training viewer",
}
"""The package's folders, lowest first, with those that each may import."""


def test_folders_import_only_lower_folders() -> None:
    root = Path(pocketgs.__file__).parent
    order = list(FOLDERS)
    modules = {path.stem for path in root.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert modules == {*FOLDERS, "__init__", "__main__", "__pycache__"}
    for folder, allowed in FOLDERS.items():
        assert all(order.index(other) < order.index(folder) for other in allowed.split()), folder
        for path in [root / f"{folder}.py", *(root / folder).rglob("*.py")]:
            found = {name.split(".")[1] for name in imported_anywhere(path) if name.startswith("pocketgs.")}
            assert found <= {folder, *allowed.split()}, path.relative_to(root)


def imported_anywhere(path: Path) -> Iterator[str]:
    """The modules that a module imports, wherever it does so."""
    if path.is_file():
        for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(statement, ast.Import):
                yield from (name.name for name in statement.names)
            elif isinstance(statement, ast.ImportFrom) and statement.module:
                yield statement.module
