"""Text as `.ply`: the arrays that plyfile gives, much sooner, and rows that are none."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.files import ply_text
from pocketgs.files.ply_file import read_comments, read_elements, read_vertices

KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
HEADER = ["ply", "format ascii 1.0", "element vertex 3", "property float x", "property uchar red", "end_header"]


def written(path: Path, rows: Sequence[str], header: Sequence[str] = HEADER, line_end: str = "\n") -> Path:
    path.write_bytes(line_end.join([*header, *rows, ""]).encode())
    return path


def test_arrays_are_those_of_plyfile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every type at its bounds, in more than one block of rows; a second element too."""
    monkeypatch.setattr(ply_text, "BLOCK", 4)
    rng = np.random.default_rng(0)
    vertices = np.zeros(11, [*KINDS.items(), ("float64", "f8")])
    for name, kind in KINDS.items():
        if kind[0] in "iu":
            vertices[name] = rng.integers(np.iinfo(kind).min, np.iinfo(kind).max, 11, endpoint=True)
            vertices[name][:2] = np.iinfo(kind).min, np.iinfo(kind).max
    vertices["float"] = rng.normal(0, 1e-30, 11)
    vertices["float64"] = rng.normal(0, 1e200, 11)
    vertices["float"][:3] = np.nan, np.inf, -0.0
    cameras = np.array([(1.5,), (0.1,)], [("focal", "f4")])
    elements = [PlyElement.describe(vertices, "vertex"), PlyElement.describe(cameras, "camera")]
    PlyData(elements, text=True).write(str(tmp_path / "a.ply"))
    found = read_elements(tmp_path / "a.ply")
    assert list(found) == ["vertex", "camera"]
    for element in PlyData.read(str(tmp_path / "a.ply")).elements:
        assert found[element.name].dtype == element.data.dtype
        assert found[element.name].tobytes() == element.data.tobytes()


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_line_ends(tmp_path: Path, line_end: str) -> None:
    path = written(tmp_path / "a.ply", ["1 2", "\t3.5   4 ", "-5e3 6"], line_end=line_end)
    assert read_vertices(path).tolist() == [(1, 2), (3.5, 4), (-5000, 6)]


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["1 2", "3 4"], "cut short: 2 rows of element 'vertex', expected 3"),
        (["1 2", "3", "4 5 6"], "row 1 of element 'vertex' has 1 words, expected 2"),
        (["1 2", "3 4 5", "6"], "row 1 of element 'vertex' has 3 words, expected 2"),
        (["1 2", "", "3 4", "5 6"], "row 1 of element 'vertex' has 0 words, expected 2"),
        (["1 2", "3 4", "5 red"], "row 2 of element 'vertex': could not convert string to float: 'red'"),
        (["1 2", "3 4", "5 6.5"], "property 'red' holds a number that is no uint8"),
        (["1 2", "3 256", "5 6"], "property 'red' holds a number that is no uint8"),
        (["1 2", "3 nan", "5 6"], "property 'red' holds a number that is no uint8"),
        (["1 2", "3 é", "5 6"], "a.ply: not a readable .ply"),
    ],
)
def test_rows_that_are_wrong(tmp_path: Path, rows: list[str], told: str) -> None:
    with pytest.raises(PocketGSError, match=told):
        read_vertices(written(tmp_path / "a.ply", rows))


def test_lists_are_left_to_plyfile(tmp_path: Path) -> None:
    header = [*HEADER[:-1], "element face 1", "property list uchar int vertex_indices", "end_header"]
    found = read_elements(written(tmp_path / "a.ply", ["1 2", "3 4", "5 6", "3 0 1 2"], header))
    assert found["vertex"].tolist() == [(1, 2), (3, 4), (5, 6)]
    assert found["face"]["vertex_indices"][0].tolist() == [0, 1, 2]


def test_many_rows_take_less_time_than_plyfile(tmp_path: Path) -> None:
    columns = np.random.default_rng(0).normal(size=(500, 60)).astype("f4")
    rows = columns.view([(f"p{place}", "f4") for place in range(60)]).reshape(-1)
    PlyData([PlyElement.describe(rows, "vertex")], text=True).write(str(tmp_path / "a.ply"))

    def least_time(read: Callable[[], object]) -> float:
        times = []
        for _ in range(3):
            start = time.process_time()
            read()
            times.append(time.process_time() - start)
        return min(times)

    theirs = least_time(lambda: PlyData.read(str(tmp_path / "a.ply")))
    assert least_time(lambda: read_elements(tmp_path / "a.ply")) < 0.7 * theirs


def test_comments_that_contain_the_last_line(tmp_path: Path) -> None:
    comments = ["comment before end_header is a header", "comment second"]
    path = written(tmp_path / "a.ply", ["1 2", "3 4", "5 6"], [*HEADER[:2], *comments, *HEADER[2:]])
    assert read_comments(path) == ["before end_header is a header", "second"]
    assert read_vertices(path).tolist() == [(1, 2), (3, 4), (5, 6)]
    with pytest.raises(PocketGSError, match="no end_header in its first"):
        read_vertices(written(tmp_path / "b.ply", [], [*HEADER[:2], "comment end_header"]))
