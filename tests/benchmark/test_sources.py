"""Results record the source code and the conditions of their measurement."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pocketgs.benchmark.conditions import present_conditions
from pocketgs.benchmark.machine import describe_machine
from pocketgs.benchmark.sources import PACKAGE, digest_of_sources


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of few sources."""
    for place in (
        "run.py",
        "splat/adam.py",
        "splat/webgpu/sort.wgsl",
        "benchmark/table.py",
        "cli/commands/bench.py",
        "viewer/a.py",
    ):
        path = tmp_path / "package" / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(place)
    return tmp_path / "package"


def edit(package: Path, place: str) -> None:
    (package / place).write_text("other")


@pytest.mark.parametrize(
    "change",
    [
        lambda package: edit(package, "run.py"),
        lambda package: edit(package, "splat/adam.py"),
        lambda package: edit(package, "splat/webgpu/sort.wgsl"),
        lambda package: edit(package, "more.py"),
        lambda package: (package / "run.py").unlink(),
        lambda package: (package / "run.py").rename(package / "walk.py"),
    ],
)
def test_what_runs_compute_with_makes_a_difference(package: Path, change: Callable[[Path], None]) -> None:
    before = digest_of_sources(package)
    change(package)
    assert digest_of_sources(package) != before


@pytest.mark.parametrize(
    "place", ["benchmark/table.py", "cli/commands/bench.py", "viewer/a.py", "viewer/b.wgsl", "splat/notes.md"]
)
def test_what_measures_asks_and_shows_makes_none(package: Path, place: str) -> None:
    before = digest_of_sources(package)
    edit(package, place)
    assert digest_of_sources(package) == before


def test_where_the_package_lies_makes_no_difference(tmp_path: Path) -> None:
    copy = shutil.copytree(PACKAGE, tmp_path / "copy", ignore=shutil.ignore_patterns("__pycache__", "viewer"))
    assert digest_of_sources(Path(copy)) == digest_of_sources()


def test_present_conditions_are_of_this_machine_and_these_sources() -> None:
    conditions = present_conditions(("--iterations", "500", "--gpu", "a b"))
    assert conditions.settings == "--iterations 500 --gpu 'a b'"
    assert (conditions.sources, conditions.machine) == (digest_of_sources(), describe_machine())
