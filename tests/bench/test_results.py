"""Results are kept whole, and what is no result is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pocketgs.bench.results import Cell, CellResult, read_result, read_results, write_result
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
    ["", "{", "[]", "{}", '{"format": 0}', '{"format": 1, "cell": {"capture": "fern"}, "command": ""}'],
)
def test_what_is_no_result_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "fern.pocketgs.0.json"
    path.write_text(text)
    with pytest.raises(PocketGSError, match=r"fern\.pocketgs\.0\.json"):
        read_results(tmp_path)


def test_a_result_that_cannot_be_written_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = write_result(tmp_path, RESULT)
    with pytest.raises(TypeError):
        write_result(tmp_path, CellResult(RESULT.cell, "", run={"psnr": object()}))
    assert json.loads(path.read_text())["run"] == {"psnr": 28.9}
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
