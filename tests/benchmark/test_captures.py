"""The captures of a table, and the messages for missing ones."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

from pocketgs.benchmark.captures import DATA_VARIABLE, captures_named, data_folder, known_captures
from pocketgs.benchmark.cell import Job
from pocketgs.benchmark.methods import METHODS
from pocketgs.capture.synthetic import demo_capture
from pocketgs.cli import main
from pocketgs.errors import PocketGSError


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A folder of data with a fern in it and nothing else."""
    (tmp_path / "data" / "fern").mkdir(parents=True)
    return tmp_path / "data"


def test_all_that_are_there_are_taken_if_none_is_named(data: Path) -> None:
    known = known_captures(data, data / "demo")
    assert [capture.name for capture in captures_named((), known)] == ["fern", "demo"]


def test_a_missing_capture_is_refused_with_its_origin(data: Path) -> None:
    with pytest.raises(PocketGSError, match=r"capture 'fox': no folder .*fox.*instant-ngp"):
        captures_named(("fern", "fox"), known_captures(data, data / "demo"))


def test_a_folder_of_ones_own_is_read_as_asked(data: Path, tmp_path: Path) -> None:
    own = tmp_path / "garden"
    own.mkdir()
    fern, garden = captures_named(("fern", str(own)), known_captures(data, data / "demo"), ("--downscale", "4"))
    assert (garden.name, garden.path, garden.flags) == ("garden", own, ("--downscale", "4"))
    assert fern.flags == ("--images", "images_8")


def test_names_that_do_not_tell_results_apart_are_refused(data: Path, tmp_path: Path) -> None:
    gardens = [tmp_path / place / "garden" for place in ("here", "there")]
    for garden in gardens:
        garden.mkdir(parents=True)
    with pytest.raises(PocketGSError, match="'garden': named twice"):
        captures_named(tuple(map(str, gardens)), known_captures(data, data / "demo"))
    (tmp_path / ".hidden").mkdir()
    with pytest.raises(PocketGSError, match="hidden': its name begins with a dot"):
        captures_named((str(tmp_path / ".hidden"),), known_captures(data, data / "demo"))
    with pytest.raises(PocketGSError, match="'fern': named twice"):
        captures_named(("fern", "fern"), known_captures(data, data / "demo"))


def test_a_folder_with_the_name_of_a_known_capture_is_refused(data: Path, tmp_path: Path) -> None:
    (tmp_path / "mine" / "fern").mkdir(parents=True)
    with pytest.raises(PocketGSError, match=r"fern': has the name of a known capture, expected another name"):
        captures_named((str(tmp_path / "mine" / "fern"),), known_captures(data, data / "demo"))


@pytest.mark.parametrize("names", [("fern",), ("fern", "demo"), ()])
def test_how_known_captures_are_read_is_not_for_the_user_to_say(data: Path, names: tuple[str, ...]) -> None:
    with pytest.raises(PocketGSError, match=r"--downscale 4: not for fern.*expected a folder of your own"):
        captures_named(names, known_captures(data, data / "demo"), ("--downscale", "4"))


def test_a_capture_is_typed_as_its_folder(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = known_captures(data, Path("output/demo-capture"))
    (tmp_path / "garden").mkdir()
    monkeypatch.chdir(tmp_path / "garden")
    (here,) = captures_named((".",), known)
    chosen = [known["fern"], known["demo"], here]
    assert [(capture.name, capture.folder_name) for capture in chosen] == [
        ("fern", "fern"),
        ("demo", "demo-capture"),
        ("garden", "garden"),
    ]
    assert Job(METHODS["pocketgs"], known["demo"], 0).command == "pocketgs train demo-capture --seed 0"


def test_the_demo_is_described_with_its_number_of_frames(data: Path) -> None:
    frames = inspect.signature(demo_capture).parameters["frames"].default
    assert f"{frames} frames" in known_captures(data, data / "demo")["demo"].what


def test_what_is_neither_known_nor_a_folder_is_refused(data: Path) -> None:
    with pytest.raises(PocketGSError, match=r"capture 'nowhere': no folder nowhere.*fern, lego, fox, demo"):
        captures_named(("nowhere",), known_captures(data, data / "demo"))


def test_the_data_folder_is_the_one_named_or_that_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DATA_VARIABLE, "elsewhere")
    assert data_folder(Path("here")) == Path("here")
    assert data_folder(None) == Path("elsewhere")
    monkeypatch.delenv(DATA_VARIABLE)
    assert data_folder(None) == Path("data")


def test_the_list_says_what_is_missing_and_where_to_get_it(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    main(["bench", "--list", "--data", str(data)])
    lines = capsys.readouterr().out.splitlines()
    (lego,) = [line for line in lines if line.strip().startswith("lego")]
    assert "missing" in lego
    assert "https://www.matthewtancik.com/nerf" in lego
    (fern,) = [line for line in lines if line.strip().startswith("fern")]
    assert "missing" not in fern
    assert any("--recipe reference" in line for line in lines)
