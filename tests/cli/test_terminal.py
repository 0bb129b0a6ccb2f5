"""File names are printed literally, whatever characters they contain."""

from __future__ import annotations

import io
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from cli.conftest import Outcome
from pocketgs.cli.compression_table import print_figures
from pocketgs.cli.display import Display
from pocketgs.cli.run_lines import STAGES
from pocketgs.cli.run_result import print_evaluation
from pocketgs.cli.terminal import Terminal, printable
from pocketgs.compression.figures import Figures
from pocketgs.compression.views import Views
from pocketgs.metrics.evaluation import Evaluation, ImageMetrics

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


@pytest.mark.parametrize("columns", [30, 60, 100])
def test_a_narrow_terminal_cuts_neither_names_nor_figures(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], columns: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    images = [ImageMetrics("images_8/image000.png", 128.43, 0.9185, 28.5, 0.1119, 0.1234)]
    print_evaluation(Terminal(), Evaluation(images))
    shown = capsys.readouterr().out
    assert "128.43 │ 28.50" in re.sub(" +", " ", shown)
    assert "0.9185 │ 0.1119 │ 0.1234" in re.sub(" +", " ", shown)
    names = [line.split("│")[1].strip() for line in shown.splitlines() if line.startswith("│")]
    assert "images_8/image000.png" in "".join(names)
    rows = [Figures("original", 1_051_229, 8.4, 29.55, 0.921)]
    print_figures(Terminal(), rows, Views([], [], [], (0.0, 0.0, 0.0), True))
    assert "1,051,229 │ 8.400" in re.sub(" +", " ", capsys.readouterr().out)


def test_tables_in_files_are_as_wide_as_they_need(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    name = "images/IMG_20240612_134502_HDR_portrait_00001.jpg"
    print_evaluation(Terminal(), Evaluation([ImageMetrics(name, 28.43, 0.9185, 28.5, 0.1119, 0.1234)]))
    assert name in capsys.readouterr().out


def test_a_dumb_terminal_gets_plain_lines(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("FORCE_COLOR", "1")  # counts as a terminal
    console = Terminal()
    assert console.is_terminal
    with Display(console).showing() as reporter:
        reporter.on_stage("poses")
    assert STAGES["poses"] in capsys.readouterr().out


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
