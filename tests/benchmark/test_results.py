"""Results survive a round trip, and other files are refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pocketgs.benchmark.results import Cell, CellResult, read_result, read_results, write_result
from pocketgs.errors import PocketGSError

RESULT = CellResult(Cell("fern", "pocketgs", 1), "pocketgs train fern --seed 1", None, 20.5, {"ply": 7}, {"psnr": 28.9})


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = write_result(tmp_path / "results", RESULT)
    assert path.name == "fern.pocketgs.1.json"
    assert read_result(path) == RESULT


def test_results_come_sorted_by_capture_method_and_seed(tmp_path: Path) -> None:
    cells = [Cell("fox", "a", 0), Cell("fern", "b", 10), Cell("fern", "b", 2), Cell("fern", "a", 3)]
    for cell in cells:
        write_result(tmp_path, CellResult(cell, ""))
    assert [result.cell for result in read_results(tmp_path)] == sorted(cells)
    assert read_results(tmp_path / "none") == []


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "{}",
        '{"format": 0}',
        '{"format": 1}',
        '{"format": 1, "cell": {"capture": "fern"}, "command": ""}',
        '{"format": 1, "cell": {"capture": "fern", "method": "pocketgs", "seed": "0"}, "command": ""}',
        '{"format": 1, "cell": {"capture": "fern", "method": "pocketgs", "seed": 0, "more": 1}, "command": ""}',
        '{"format": 1, "cell": {"capture": "fern", "method": "pocketgs", "seed": 0}}',
    ],
)
def test_what_is_no_result_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "fern.pocketgs.0.json"
    path.write_text(text)
    with pytest.raises(PocketGSError, match=r"fern\.pocketgs\.0\.json"):
        read_results(tmp_path)


@pytest.mark.parametrize("name", ["command", "error", "wall_seconds", "scene_bytes", "run", "sources", "machine"])
@pytest.mark.parametrize("value", [None, [], True])
def test_a_result_with_something_else_in_a_field_is_refused(tmp_path: Path, name: str, value: object) -> None:
    path = write_result(tmp_path, RESULT)
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: value}))
    if (name, value) in (("error", None), ("wall_seconds", True)):  # a bool is a number, and does no harm
        assert read_result(path).cell == RESULT.cell
        return
    with pytest.raises(PocketGSError, match=rf"fern\.pocketgs\.1\.json: its {name} is"):
        read_results(tmp_path)


def test_a_result_from_before_conditions_were_kept_is_read(tmp_path: Path) -> None:
    path = write_result(tmp_path, RESULT)
    document = json.loads(path.read_text())
    del document["settings"], document["sources"]
    path.write_text(json.dumps(document))
    assert read_result(path) == RESULT


def test_what_a_killed_process_left_half_written_is_no_result(tmp_path: Path) -> None:
    write_result(tmp_path, RESULT)
    (tmp_path / ".fern.pocketgs.1.0a1b2c3d.partial.json").write_text('{"format": 1, "ce')
    assert read_results(tmp_path) == [RESULT]


def test_a_result_that_cannot_be_written_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = write_result(tmp_path, RESULT)
    with pytest.raises(TypeError):
        write_result(tmp_path, CellResult(RESULT.cell, "", run={"psnr": object()}))
    assert json.loads(path.read_text())["run"] == {"psnr": 28.9}
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
