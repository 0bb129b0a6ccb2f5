"""Cached machine code belongs to one state of the sources."""

from __future__ import annotations

from pathlib import Path

from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.system import compile as compilation

CPU = compilation.PACKAGE / "splat" / "cpu"


def test_cached_code_is_kept_by_the_state_of_its_rooms_sources() -> None:
    folder = Path(rasterize.stats.cache_path)  # type: ignore[attr-defined]
    assert any(part == f"splat.cpu-{compilation._digest_of('splat.cpu')}" for part in folder.parts)


def test_kernels_depend_on_what_they_are_made_from_and_on_nothing_else() -> None:
    made_from = {path.relative_to(compilation.PACKAGE).as_posix() for path in compilation._sources_of(CPU)}
    assert {"splat/cpu/adam.py", "splat/cpu/lanes.py", "splat/constants.py", "system/dealing.py"} <= made_from
    # Through `project.py`, `lenses/formulas.py` and the package that it imports from.
    assert "splat/cpu/lenses/fisheye.py" in made_from
    assert "splat/webgpu/engine.py" not in made_from
    assert "training/loop.py" not in made_from
