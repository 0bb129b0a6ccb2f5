"""The commands in README and docs work, and print what the docs show."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest

from documentation import PAGES, ROOT, SUBCOMMANDS, Command, commands, options, tables
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli import main
from pocketgs.cli.commands.bench import Everywhere
from pocketgs.extras import how_to_install

if sys.version_info >= (3, 11):
    import tomllib
else:
    tomllib = pytest.importorskip("tomllib")

COMMANDS = commands()
PLACEHOLDERS = re.compile(r"path/to/\w+|[A-Z_]{4,}|NAME|MORE|…")
RUN = ("eval", "render", "convert", "distil", "info", "export-colmap", "train")
"""Subcommands that take seconds on a small capture; the others are run by tests of their own."""


def of(program: str) -> list[Command]:
    return [command for command in COMMANDS if command.program == program]


@pytest.fixture(scope="module")
def help_of() -> Callable[[str], str]:
    """A function that returns the output of `pocketgs SUBCOMMAND --help`."""

    @cache
    def ask(subcommand: str) -> str:
        with pytest.MonkeyPatch.context() as patch:
            printed: list[str] = []
            patch.setattr(sys.stdout, "write", printed.append)
            with pytest.raises(SystemExit):
                main([subcommand, "--help"])
        return re.sub(r"\x1b\[[0-9;]*m", "", "".join(printed))

    return ask


def accepts(told: str, option: str, value: str | None) -> bool:
    """Whether a help text has an option, and among its choices, where it lists them all, a value."""
    found = re.search(rf"(?<![\w-]){re.escape(option)}(?![\w-])(?:, --[\w-]+)* ?([^\s│]*)", told)
    if found is None:
        return False
    is_list = re.fullmatch(r"\{[^}]*\}(\|\{[^}]*\})*", found[1])
    choices = re.split(r"[{},|]+", found[1]) if is_list else None
    return choices is None or value is None or value in choices or bool(PLACEHOLDERS.fullmatch(value))


def pairs(arguments: tuple[str, ...]) -> list[tuple[str, str | None]]:
    """Each option with the argument after it."""
    given = [pair for pair in pairwise([*arguments, "--"]) if pair[0].startswith("--")]
    return [(option, None if value.startswith("--") else value) for option, value in given]


def test_there_are_commands_to_check() -> None:
    assert len(of("pocketgs")) > 20
    assert {command.arguments[0] for command in of("pocketgs") if command.arguments} == set(SUBCOMMANDS)


@pytest.mark.parametrize("command", of("pocketgs"), ids=str)
def test_pocketgs_knows_its_options(command: Command, help_of: Callable[[str], str]) -> None:
    subcommand, *rest = command.arguments
    assert subcommand in SUBCOMMANDS
    for option, value in pairs(tuple(rest)):
        assert accepts(help_of(subcommand), option, value), f"{option} {value or ''}"


def test_options_in_sentences_exist(help_of: Callable[[str], str]) -> None:
    told = [help_of(subcommand) for subcommand in SUBCOMMANDS]
    for page, words in options():
        for option, value in pairs(tuple(shlex.split(words))):
            assert any(accepts(each, option, value) for each in told), f"{page}: {words}"


def test_the_benchmarks_page_names_the_flags_of_all_cells() -> None:
    page = (ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
    [named] = re.findall(r"common\s+flags\s+\(([^)]*)\)", page)
    assert re.findall(r"--[\w-]+", named) == [flag for flag in Everywhere().flags if flag.startswith("--")]


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.program.endswith(".py")], ids=str)
def test_scripts_and_their_options_exist(command: Command) -> None:
    path = ROOT / command.program
    assert path.is_file()
    source = path.read_text(encoding="utf-8")
    for option, _ in pairs(command.arguments):
        name = option[2:].replace("-", "_")
        is_field = re.search(rf"\b{name}\b\s*:", source) or (
            "CaptureOptions" in source and name in CaptureOptions.__dataclass_fields__
        )
        assert f'"{option}"' in source or is_field, option


@pytest.mark.parametrize("command", of("make"), ids=str)
def test_make_has_its_targets(command: Command) -> None:
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(command.arguments) <= set(targets)


@pytest.mark.parametrize("command", of("pip"), ids=str)
def test_packages_have_their_extras(command: Command) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for name in re.findall(r"\[([\w,]+)\]", " ".join(command.arguments)):
        assert set(name.split(",")) <= set(extras)


def test_no_index_is_asked_for_this_package() -> None:
    """It has none, and another package might get its name: extras are installed from the folder."""
    assert "pip install '.[lpips]'" in how_to_install("lpips")
    for path in (*PAGES, *(ROOT / "src").rglob("*.py"), *(ROOT / "tools").rglob("*.py")):
        assert not re.search(r"pip install '?pocketgs", path.read_text(encoding="utf-8")), path


@pytest.fixture(scope="module")
def place(written_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder where a reader might sit: a capture and a result under the names that pages use."""
    folder = tmp_path_factory.mktemp("reader")
    shutil.copytree(written_capture, folder / "fern")
    shutil.copytree(folder / "fern" / "images", folder / "fern" / "images_8")
    for name in ("fern", "lego", "fox", "photographs"):
        shutil.copytree(folder / "fern", folder / "path" / "to" / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        # The memory of tests that ran before in this process counts too.
        options = "--prior none --iterations 2 --evaluate-every 0 --max-memory 10000"
        main(shlex.split(f"train fern --output result {options}"))
    return folder


def runnable() -> list[Command]:
    """Commands to be copied that take seconds, in the order in which they stand."""
    typed = [command for command in of("pocketgs") if command.typed and command.arguments[0] in RUN]
    return [
        command
        for command in typed
        if not set(command.arguments) & {"--view", "SCENE", "--max-memory", "PHOTOGRAPHS_OR_VIDEO"}
    ]


def test_commands_run_as_they_stand(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    assert len(runnable()) >= 10
    for command in runnable():
        quick = {
            "train": ["--prior", "none", "--iterations", "2", "--max-size", "48", "--max-memory", "10000"],
            "render": ["--frames", "3"],
            "distil": ["--iterations", "2"],
        }
        shutil.rmtree("fern-colmap", ignore_errors=True)
        # A box of fern's own would hold nothing of what stands in for it.
        box = ["-99", "-99", "-99", "99", "99", "99"]
        arguments = list(command.arguments)
        if "--crop-box" in arguments:
            start = arguments.index("--crop-box") + 1
            arguments[start : start + 6] = box
        try:
            main([*arguments, *quick.get(command.arguments[0], [])])
        except SystemExit as stop:
            pytest.fail(f"{command}: exit status {stop.code}: {capsys.readouterr().err}")
        assert capsys.readouterr().out, command


@cache
def cpu_step() -> ModuleType:
    """The benchmark of a step, as a module."""
    spec = importlib.util.spec_from_file_location("cpu_step", ROOT / "bench" / "cpu_step.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_of_a_step_is_what_its_command_prints(data_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In kind: the same columns, and rows of the same scenes. How long a step takes differs between machines."""
    [table] = [each for each in tables() if "bench/cpu_step.py" in each.before]
    [stated] = [each for each in of("bench/cpu_step.py") if shlex.join(each.arguments) in table.before]
    monkeypatch.setattr(sys, "path", [*sys.path, str(ROOT / "bench")])
    module = cpu_step()
    assert table.header == ("", *module.PASSES, "step")
    monkeypatch.setattr(module, "ITERATIONS", 1)
    capture = data_folder / Path(stated.arguments[0]).name
    reading = CaptureOptions(**{option[2:]: value for option, value in pairs(stated.arguments)})  # type: ignore[arg-type]
    printed = [f"random, {count:,} Gaussians, {width}x{height}" for count, width, height in module.SIZES]
    for name, scene, frames in module.scenes(capture, reading):
        camera = frames[0].camera
        printed.append(f"{name}, {len(scene):,} Gaussians, {camera.width}x{camera.height}")
    assert {row[0] for row in table.rows} <= set(printed)
    assert printed[-1] in {row[0] for row in table.rows}, "the command that is stated has a row"
