"""File names are printed literally, whatever characters they contain."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from cli.conftest import Outcome
from pocketgs.cli.terminal import Terminal, printable

HOSTILE = "a\x1b]0;owned\x07\x1b[2J[red]b\u202e\nc\x9b31m"
SHOWN = r"a\x1b]0;owned\x07\x1b[2J[red]b\u202e\nc\x9b31m"

needs_any_name = pytest.mark.skipif(sys.platform == "win32", reason="Windows allows no such names")


@given(st.text())
def test_printable_text_steers_nothing_and_stays(text: str) -> None:
    shown = printable(text)
    assert printable(shown) == shown
    assert not any(char in "\x00\x07\x08\n\r\x1b\x7f\x85\x9b\u2028\u202e\ud800" for char in shown)
    if text.isprintable():
        assert shown == text


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_whatever_is_printed_is_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    found = Screen()
    shown = Terminal()
    shown.file = found
    shown.say(HOSTILE, "a second line", style="red")
    table = Table("name")
    table.add_row(HOSTILE)
    shown.print(table, soft_wrap=False)
    shown.print(HOSTILE)
    with shown.status(HOSTILE):
        pass
    left = found.getvalue()
    for sequence in ("\x1b]0;", "\x07", "\x1b[2J", "\u202e", "\x9b"):
        assert sequence not in left
    assert SHOWN in left
    assert "\x1b[?25l" in left, "its own commands to the terminal stay"


@needs_any_name
def test_names_in_errors_and_results(pocketgs: Callable[..., Outcome], result: Path, tmp_path: Path) -> None:
    folder = tmp_path / HOSTILE
    refused = pocketgs("info", folder / "none.ply")
    assert refused.status == 2
    assert "\x1b" not in refused.errors
    assert r"a\x1b]0;owned" in refused.errors
    assert refused.errors.count("\n") == 1
    folder.mkdir()
    written = pocketgs("convert", result, folder / "scene.splat")
    assert written.status == 0
    assert SHOWN in written.output


@needs_any_name
def test_names_of_photographs(
    pocketgs: Callable[..., Outcome], written_capture: Path, result: Path, tmp_path: Path
) -> None:
    capture = Path(shutil.copytree(written_capture, tmp_path / "capture"))
    transforms = capture / "transforms.json"
    first = min((capture / "images").iterdir())
    first.rename(first.with_name(f"{first.stem[:-1]}\x1b[2J{first.suffix}"))
    named = transforms.read_text().replace(first.name, f"{first.stem[:-1]}\\u001b[2J{first.suffix}")
    transforms.write_text(named)
    evaluated = pocketgs("eval", result, capture)
    assert evaluated.status == 0
    assert r"\x1b[2J" in evaluated.output
    assert "\x1b" not in evaluated.output


def test_undecodable_names(pocketgs: Callable[..., Outcome]) -> None:
    refused = pocketgs("info", "\udcff.ply")
    assert (refused.status, refused.errors) == (2, "pocketgs: \\udcff.ply: no such file, expected a .ply\n")
