"""The charts of a report."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.plots import _line_style, curves_svg, memory_svg, stages_svg, write_overview
from pocketgs.benchmark.results import CellResult
from pocketgs.benchmark.series import CurvePoint, curves, mean_curve, traces
from pocketgs.errors import PocketGSError

MakeResult = Callable[..., CellResult]
CHARTS = (curves_svg, stages_svg, memory_svg)


def words(svg: str) -> list[str]:
    """The pieces of text in a chart."""
    root = ElementTree.fromstring(svg.replace("<svg", '<svg xmlns:xlink="x"', 1))
    return ["".join(element.itertext()) for element in root.iter("text")]


def test_looks_without_a_time_or_a_number_are_left_out(made_result: MakeResult) -> None:
    progress = [
        {"iteration": 10, "held_out_psnr": 20.0},
        {"iteration": 20, "elapsed": 5.0, "held_out_psnr": math.nan},
        {"iteration": 30, "elapsed": 6.0, "held_out_psnr": None},
        {"iteration": 40, "elapsed": 7.0, "held_out_psnr": 22.0},
    ]
    assert curves([made_result(progress=progress)], "fern") == {"pocketgs": [[CurvePoint(40, 7.0, 22.0)]]}
    assert curves([made_result(progress=progress[:3])], "fern") == {}


def test_a_mean_curve_is_of_the_looks_that_all_seeds_had() -> None:
    first = [CurvePoint(10, 1.0, 20.0), CurvePoint(20, 2.0, 22.0)]
    second = [CurvePoint(20, 4.0, 23.0), CurvePoint(30, 5.0, 24.0)]
    assert mean_curve([first, second]) == [CurvePoint(20, 3.0, 22.5)]
    assert mean_curve([first]) == first


def test_memory_is_that_of_the_first_run_that_has_it(made_result: MakeResult) -> None:
    trace = [{"seconds": 1.0, "stage": "depth", "rss_mb": 300.0}]
    results = [made_result(seed=0, memory=[]), made_result(seed=1, memory=trace), made_result(seed=2)]
    assert [(it.seconds, it.rss_mb, it.stage) for it in traces(results, "fern")["pocketgs"]] == [(1.0, 300.0, "depth")]


def test_charts_name_methods_stages_and_peaks(many_results: list[CellResult]) -> None:
    quality, time, memory = (words(chart(many_results, "fern") or "") for chart in CHARTS)
    assert {"pocketgs", "3dgs-sfm", "no-seeding", "held-out PSNR (dB)"} <= set(quality)
    assert {"depth", "training", "15.0", "22.5"} <= set(time)
    assert "pocketgs 260 MB, depth" in memory


@pytest.mark.parametrize("chart", CHARTS)
def test_a_chart_says_in_words_what_it_shows(chart: Callable, many_results: list[CellResult]) -> None:
    svg = chart(many_results, "fox")
    assert re.match(
        r'<svg role="img" aria-label="[^"]*seconds[^"]*fox[^"]*pocketgs [\d.]+ (dB|s|MB)', svg, re.IGNORECASE
    )


@pytest.mark.parametrize("chart", CHARTS)
def test_what_there_is_nothing_of_has_no_chart(chart: Callable, made_result: MakeResult) -> None:
    assert chart([made_result(progress=[], memory=None, seconds={})], "fern") is None


@pytest.mark.parametrize("chart", CHARTS)
def test_names_are_shown_as_they_are(chart: Callable, made_result: MakeResult) -> None:
    hostile = '<script>"$x_1$&'
    svg = chart([made_result(hostile, hostile)], hostile)
    assert any(hostile in text for text in words(svg))
    assert "<script" not in svg


@pytest.mark.parametrize("chart", CHARTS)
def test_marks_within_charts_are_their_own(chart: Callable, many_results: list[CellResult]) -> None:
    ids = []
    for capture in ("fern", "fox"):
        svg = chart(many_results, capture)
        own = re.findall(r'\bid="([^"]+)"', svg)
        assert set(re.findall(r'url\(#([^)]+)\)|href="#([^"]+)"', svg)) <= {(it, "") for it in own} | {
            ("", it) for it in own
        }
        ids += own
    assert len(ids) == len(set(ids))


def test_methods_can_be_told_apart() -> None:
    styles = [str(_line_style(name)) for name in METHODS]
    assert len(set(styles)) == len(METHODS)
    assert len({(_line_style(name)["color"], _line_style(name)["linestyle"]) for name in METHODS}) == len(METHODS)


def test_an_overview_shows_all_captures(many_results: list[CellResult], tmp_path: Path) -> None:
    write_overview(many_results, tmp_path / "two.png")
    write_overview([it for it in many_results if it.cell.capture == "fox"], tmp_path / "one.png")
    with Image.open(tmp_path / "two.png") as two, Image.open(tmp_path / "one.png") as one:
        assert two.width == pytest.approx(2 * one.width, abs=2)
    write_overview(many_results[::-1], tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_of_nothing_there_is_no_overview_and_no_earlier_one(made_result: MakeResult, tmp_path: Path) -> None:
    for before in ({}, {"overview.png": b"earlier"}):
        for name, content in before.items():
            (tmp_path / name).write_bytes(content)
        write_overview([made_result(progress=[])], tmp_path / "overview.png")
        assert not list(tmp_path.iterdir())


def test_that_matplotlib_is_missing_is_said(
    many_results: list[CellResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(PocketGSError, match=re.escape("pip install '.[bench]'")):
        write_overview(many_results, tmp_path / "overview.png")
