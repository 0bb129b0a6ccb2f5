"""The HTML report of a benchmark: one self-contained file that makes no requests."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.resources import files
from pathlib import Path

import numpy as np
from PIL import Image

from pocketgs.benchmark.aggregate import captures_of
from pocketgs.benchmark.crops import Crop, choose_crop
from pocketgs.benchmark.plots import colour_of, curves_svg, memory_svg, stages_svg
from pocketgs.benchmark.results import CellResult
from pocketgs.benchmark.sections import (
    Table,
    commands,
    differences_table,
    failures_table,
    figures_table,
    machines_table,
    methods_table,
    protocol_lines,
    stages_table,
    summary_table,
)
from pocketgs.errors import PocketGSError
from pocketgs.extras import how_to_install
from pocketgs.files.atomic_file import replacing

TEMPLATE = "report.html.jinja"

NEEDED = ("jinja2", "matplotlib")

QUALITY = 90
"""JPEG quality of crops: its loss is far below the differences between methods."""


@dataclass(frozen=True)
class Chart:
    """A chart: its caption, and an `<svg>` element, which is not escaped."""

    caption: str
    svg: str


@dataclass(frozen=True)
class Picture:
    """An image: its caption, its alternative text, and its content as a URI."""

    caption: str
    alternative: str
    uri: str
    width: int
    height: int
    colour: str | None


@dataclass(frozen=True)
class CaptureSection:
    """The report's section on a capture."""

    name: str
    protocol: list[str]
    tables: list[Table]
    stages: Table
    charts: list[Chart]
    crop: Crop | None
    pictures: list[Picture]


def check_report_possible() -> None:
    """Check before the work starts that a report can be written.

    Raises:
        PocketGSError: a required package is missing; the message names it.
    """
    for package in NEEDED:
        try:
            import_module(package)
        except ImportError as error:
            raise PocketGSError(f"reports need {package} ({error}): {how_to_install('bench')}") from error


def write_report(results: Sequence[CellResult], pictures: Path | None, path: Path) -> None:
    """Write the report. It is deterministic.

    Args:
        results: in any order; some may have failed.
        pictures: folder with a result folder per cell, by the cell's name, or None. If it contains images of held-out
            views of these results, the report shows crops of them.
        path: of the HTML file.

    Raises:
        PocketGSError: a package is missing, or the file cannot be written.
    """
    check_report_possible()
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((files("pocketgs.benchmark") / TEMPLATE).read_text(encoding="utf-8"))
    text = template.render(
        failures=failures_table(results),
        summary=summary_table(results),
        captures=[_section(results, capture, pictures) for capture in captures_of(results)],
        methods=methods_table(results),
        machines=machines_table(results),
        commands=commands(results),
    )
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _section(results: Sequence[CellResult], capture: str, pictures: Path | None) -> CaptureSection:
    charts = {
        "Quality on held-out views against time; thin lines are single seeds.": curves_svg(results, capture),
        "Where the time goes, means over seeds; the tables leave evaluation out.": stages_svg(results, capture),
        "Resident memory of each method's first run; marks are at the peaks.": memory_svg(results, capture),
    }
    crop = choose_crop(results, capture, pictures) if pictures else None
    tables = (figures_table(results, capture), differences_table(results, capture))
    return CaptureSection(
        capture,
        protocol_lines(results, capture),
        [table for table in tables if table],
        stages_table(results, capture),
        [Chart(caption, svg) for caption, svg in charts.items() if svg],
        crop,
        _pictures(crop) if crop else [],
    )


def _pictures(crop: Crop) -> list[Picture]:
    where = f"a piece of the held-out view {crop.view}"
    shown = [_picture("photograph", f"Photograph: {where}", crop.photo, None)]
    for method, rendered in crop.renderings.items():
        quality = f", {crop.psnr[method]:.2f} dB" if method in crop.psnr else ""
        shown.append(_picture(f"{method}{quality}", f"Rendering by {method}: {where}", rendered, colour_of(method)))
    return shown


def _picture(caption: str, alternative: str, pixels: np.ndarray, colour: str | None) -> Picture:
    content = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(content, "jpeg", quality=QUALITY, subsampling=0)
    uri = f"data:image/jpeg;base64,{base64.b64encode(content.getvalue()).decode()}"
    return Picture(caption, alternative, uri, pixels.shape[1], pixels.shape[0], colour)
