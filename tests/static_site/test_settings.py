"""Python's numbers that the page's modules need are in its settings."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import pocketgs
from pocketgs.site.files import PAGE

ROOT = Path(pocketgs.__file__).parent
COMMENT, FILE = re.compile(r"/\*\*.*?\*/", re.DOTALL), re.compile(r"`([\w/]+\.py)`")

NOT_NEEDED = {
    "layouts: what the page writes, Python reads": "scene.formats",
    "of unpacking on a server": "serve.archive",
    "stated by the twin itself, since they are no choice": """capture.decoding.depth_file.MAX_SIDE
        geometry.camera_geometry.ROUNDING
        prior.bundle.reprojection.CAMERA_UNKNOWNS prior.bundle.reprojection.COLUMNS""",
    "of how Python or OpenCV computes: caches, threads, tables, memory": """capture.last_numbers
        capture.undistortion.MAP_PIXEL capture.undistortion.MAX_KEPT capture.undistortion.MAX_REMAPPED_SIDE
        geometry.lens.KEPT_LENSES geometry.lens.MAX_FISHEYE_ANGLE geometry.lens._ANGLES geometry.lens._DIRECTIONS
        prior.bundle.adjustment.MIRRORED_AT_ONCE prior.bundle.cpu.equations prior.depth.webgpu.stereo
        splat.webgpu.photographs.PIXEL_BYTES""",
    "in the shaders": "prior.features.features.CONTRAST",
    "of plans": "prior.features.pairs.PAIRS_PER_VIEW",
    "of other recipes": "training.recipes.MAX_DEGREE training.recipes.MIN_EXTENT training.recipes._3DGS_ITERATIONS",
    "of what the page does not do": "prior.cloud.complete.GUESSED_CONFIDENCE",
}
"""Modules and numbers that are not in the settings, by why."""


def twins() -> set[Path]:
    """The Python modules that modules of the page are twins of, or parts of them."""
    comments = [text for path in PAGE.rglob("*.js") for text in COMMENT.findall(path.read_text(encoding="utf-8"))]
    names = {name for text in comments if "twin of" in text for name in FILE.findall(text)}
    return {path for name in names for path in ROOT.rglob(Path(name).name) if path.as_posix().endswith(f"/{name}")}


def numbers(path: Path) -> set[str]:
    """The constants of a module that are numbers, below `pocketgs`."""
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    statements = [each for each in _parsed(path).body if isinstance(each, (ast.Assign, ast.AnnAssign))]
    named = [each for statement in statements for each in ast.walk(statement) if isinstance(each, ast.Name)]
    constants = {each.id for each in named if isinstance(each.ctx, ast.Store) and each.id.isupper()}
    values = vars(import_module(f"pocketgs.{module}"))
    return {f"{module}.{name}" for name in constants if isinstance(values[name], (int, float))}


def used_in(path: Path) -> set[str]:
    """What a module uses of other ones, below `pocketgs`."""
    nodes = list(ast.walk(_parsed(path)))
    imports = [(node.module, each.name) for node in nodes if isinstance(node, ast.ImportFrom) for each in node.names]
    whole = {name: f"{module}.{name}".removeprefix("pocketgs.") for module, name in imports}
    parts = [(ast.unparse(node.value), node.attr) for node in nodes if isinstance(node, ast.Attribute)]
    return {*whole.values(), *(f"{whole[name]}.{part}" for name, part in parts if name in whole)}


def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def test_numbers_of_twins_are_in_the_settings() -> None:
    """A number that is new in Python is told to the page, or listed above with the reason why not."""
    told = used_in(ROOT / "site" / "settings.py") | used_in(ROOT / "site" / "prior_settings.py")
    missing = {number for path in twins() for number in numbers(path)} - told
    listed = " ".join(NOT_NEEDED.values()).split()
    reasons = {number: [one for one in listed if f"{number}.".startswith(f"{one}.")] for number in sorted(missing)}
    assert [number for number, some in reasons.items() if not some] == []
    assert {one for some in reasons.values() for one in some} == set(listed), "of these none is missing any more"
