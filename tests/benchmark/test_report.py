"""The report: one self-contained page with all measurements."""

from __future__ import annotations

import base64
import io
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from html.parser import HTMLParser
from pathlib import Path
from random import Random

import numpy as np
import pytest
from PIL import Image

from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.report import check_report_possible, write_report
from pocketgs.benchmark.results import CellResult
from pocketgs.errors import PocketGSError

MakeResult = Callable[..., CellResult]
Leave = Callable[[CellResult, Mapping[str, np.ndarray]], Path]

NEVER_CLOSED = {"meta", "img", "link", "br"}
MAX_BYTES = 3_000_000


class Page(HTMLParser):
    """A page as a browser reads it: its elements, its text, and its tables' cells by caption."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.html = html
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.tables: dict[str, list[list[str]]] = {}
        self._open: list[str] = []
        self._caption = ""
        self.feed(html)
        self.close()
        assert not self._open, f"never closed: {self._open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in NEVER_CLOSED:
            self._open.append(tag)
        if tag == "caption":
            self._caption = ""
        elif tag == "tr":
            self.tables.setdefault(self._caption, []).append([])
        elif tag in ("td", "th"):
            self.tables[self._caption][-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if "caption" in self._open:
            self._caption += data
        elif "td" in self._open or "th" in self._open:
            self.tables[self._caption][-1][-1] += data

    def attributes(self, tag: str, name: str) -> list[str | None]:
        """An attribute of all elements of a kind."""
        return [attributes.get(name) for found, attributes in self.elements if found == tag]


def report_of(results: Sequence[CellResult], folder: Path, pictures: Path | None = None) -> str:
    write_report(results, pictures, folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


def view(seed: int) -> np.ndarray:
    """A made-up picture of a view beside its rendering, as sharp as a photograph is."""
    coarse = np.random.default_rng(seed).integers(0, 255, (50, 120, 3), dtype=np.uint8)
    return np.asarray(Image.fromarray(coarse).resize((480, 200), Image.Resampling.BICUBIC))


@pytest.fixture(scope="module")
def whole_page(many_results: list[CellResult], tmp_path_factory: pytest.TempPathFactory) -> Page:
    """The report of `many_results`, without pictures."""
    return Page(report_of(many_results, tmp_path_factory.mktemp("report")))


def test_the_page_asks_for_nothing(many_results: list[CellResult], leave_pictures: Leave, tmp_path: Path) -> None:
    folder = leave_pictures(many_results[0], {"images_a": view(0)})
    html = report_of(many_results, tmp_path, folder)
    page = Page(html)
    for tag, attributes in page.elements:
        assert tag not in ("script", "link", "iframe", "object", "embed", "base", "form")
        for name, value in attributes.items():
            assert not name.startswith("on")
            if name in ("src", "href", "xlink:href", "srcset", "data", "action"):
                assert re.match(r"#|data:image/jpeg;base64,", value or ""), f"{tag} {name}={value}"
    assert not re.search(r"@import|url\((?!#)|https?:", html)
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    assert policy in page.attributes("meta", "content")


def test_links_and_marks_of_the_page_lead_somewhere(whole_page: Page) -> None:
    ids = [attributes["id"] for _, attributes in whole_page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {it[1:] for it in whole_page.attributes("a", "href") if it} <= set(ids)


def test_tables_hold_the_figures(made_result: MakeResult, tmp_path: Path) -> None:
    results = [made_result(psnr=28.905, ssim=0.9096), made_result(seed=1, psnr=28.805, ssim=0.9096, lpips=0.125)]
    results.append(made_result(method="3dgs-sfm", psnr=23.58, peak_rss_mb=308.4, gaussians=10_091))
    page = Page(report_of(results, tmp_path))
    figures = {row[0]: row for row in page.tables["Figures"]}
    head = figures["method"]
    assert figures["pocketgs"][head.index("PSNR (dB)")] == "28.86 ± 0.05"
    assert figures["pocketgs"][head.index("SSIM")] == "0.910"
    assert figures["pocketgs"][head.index("LPIPS")] == "0.125 (1 of 2)"
    assert figures["pocketgs"][head.index("time (s)")] == "30.0"
    assert figures["pocketgs"][head.index(".ply (MB)")] == "5.2"
    assert figures["3dgs-sfm"][head.index("Gaussians")] == "10,091"
    assert figures["3dgs-sfm"][head.index("peak memory (MB)")] == "308"
    assert figures["source: PocketGS"][head.index("PSNR (dB)")] == "23.54"
    assert page.tables["The source's differences and ours"][1][3:5] == ["+2.53", "+5.33"]
    assert page.tables["Seconds by stage"][1] == ["pocketgs", "1.5", "4.0", "15.0", "2.0"]
    assert ["processor", "Abacus 9"] in page.tables["Machine and versions"]
    assert "pocketgs train fern --method 3dgs-sfm --seed 0" in page.text
    assert "498x372, every 8th held out; 17 training and 3 held-out views; 500 iterations" in page.text


def test_tables_say_what_their_heads_are_of(whole_page: Page) -> None:
    assert set(whole_page.attributes("th", "scope")) == {"col", "row"}
    tables = sum(tag == "table" for tag, _ in whole_page.elements)
    assert tables == sum(tag == "caption" for tag, _ in whole_page.elements)


def test_failed_runs_are_on_the_page(whole_page: Page) -> None:
    assert whole_page.tables["Failed runs"][1:] == [
        ["fox.no-seeding.1", "it ran out of paper"],
    ]


def test_photograph_and_renderings_are_on_the_page(
    made_result: MakeResult, leave_pictures: Leave, tmp_path: Path
) -> None:
    results = [made_result(), made_result(method="no-dense")]
    leave_pictures(results[0], {"images_a": view(0)})
    page = Page(report_of(results, tmp_path, leave_pictures(results[1], {"images_a": view(0)})))
    pictures = [attributes for tag, attributes in page.elements if tag == "img"]
    assert [picture["alt"] for picture in pictures] == [
        "Photograph: a piece of the held-out view images_a",
        "Rendering by pocketgs: a piece of the held-out view images_a",
        "Rendering by no-dense: a piece of the held-out view images_a",
    ]
    for picture in pictures:
        content = base64.b64decode((picture["src"] or "").partition(",")[2], validate=True)
        with Image.open(io.BytesIO(content)) as image:
            image.load()
            assert image.size == (int(picture["width"] or 0), int(picture["height"] or 0)) == (200, 150)
    assert "pocketgs, 27.50 dB" in page.text


def test_names_are_text_and_nothing_else(
    made_result: MakeResult, failed_result: MakeResult, leave_pictures: Leave, tmp_path: Path
) -> None:
    hostile = "\"><script>alert('x')<&script> onload=x {{ 7 * 7 }}"
    result = made_result(
        hostile, hostile, protocol=hostile, lpips_note=hostile, device=hostile, versions={"a": hostile}
    )
    page = Page(report_of([result, failed_result("fern", hostile, 0, hostile)], tmp_path))
    assert "script" not in {tag for tag, _ in page.elements}
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
    assert page.text.count(hostile) >= 6


@pytest.mark.parametrize("changes", [{"progress": None, "memory": None}, {"seconds": None}, {"psnr": float("nan")}])
def test_what_is_missing_from_a_run_is_missing_from_the_page(
    made_result: MakeResult, tmp_path: Path, changes: dict[str, object]
) -> None:
    page = Page(report_of([made_result(**changes)], tmp_path))
    assert sum(tag == "svg" for tag, _ in page.elements) == 3 - (2 if "memory" in changes else "seconds" in changes)
    assert "pocketgs" in {row[0] for row in page.tables["Figures"]}
    assert "nan" not in {cell for table in page.tables.values() for row in table for cell in row}


def test_failures_alone_and_nothing_at_all_make_a_page(failed_result: MakeResult, tmp_path: Path) -> None:
    assert "it broke" in Page(report_of([failed_result("fern", "pocketgs", 0, "it broke")], tmp_path)).text
    assert "There are no results." in Page(report_of([], tmp_path)).text


def test_the_order_of_results_changes_nothing(many_results: list[CellResult], whole_page: Page, tmp_path: Path) -> None:
    shuffled = list(many_results)
    Random(0).shuffle(shuffled)
    assert report_of(shuffled, tmp_path) == whole_page.html


@pytest.mark.slow
def test_the_report_of_a_whole_table_is_small(made_result: MakeResult, leave_pictures: Leave, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    results = []
    for capture in ("demo", "fern", "fox", "lego"):
        for method in METHODS:
            for seed in (0, 1, 2):
                memory = [
                    {"seconds": 0.1 * it, "stage": "training", "rss_mb": float(value)}
                    for it, value in enumerate(rng.uniform(200, 500, 400))
                ]
                results.append(made_result(capture, method, seed, memory=memory))
            folder = leave_pictures(results[-3], {"images_a": view(len(results)), "images_b": view(-len(results) % 99)})
    assert len(report_of(results, tmp_path, folder)) < MAX_BYTES


def test_a_file_that_cannot_be_written_is_named(made_result: MakeResult, tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match=re.escape(str(tmp_path))):
        write_report([made_result()], None, tmp_path)


@pytest.mark.parametrize("package", ["jinja2", "matplotlib"])
def test_a_missing_package_is_named_before_the_work(
    package: str, made_result: MakeResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_report_possible()
    monkeypatch.setitem(sys.modules, package, None)
    for attempt in (check_report_possible, lambda: write_report([made_result()], None, tmp_path / "report.html")):
        with pytest.raises(PocketGSError, match=rf"reports need {package} .*pip install '\.\[bench\]'"):
            attempt()
    assert not list(tmp_path.iterdir())
