"""The table of size against quality at the end of a compression."""

from __future__ import annotations

from pathlib import Path

from pocketgs.cli.figure_table import print_table
from pocketgs.cli.terminal import Terminal
from pocketgs.compression.compress import Compressed
from pocketgs.compression.figures import Figures, figures_of
from pocketgs.compression.spz_file import as_spz
from pocketgs.compression.views import Views
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine

ORIGINAL, SPZ, TRIED, CHOSEN = "original", ".spz", ".pgs, tried", ".pgs, written"


def figures_table(original: Gaussians, size: int, found: Compressed, engine: Engine, views: Views) -> list[Figures]:
    """Figures of the original, of a .spz if there is time to write one, and of all candidates, largest first.

    Args:
        original: the scene, see `drawable`.
        size: of its file in bytes.
        found: the result.
        engine: renders.
        views: of the compression.
    """
    spz = as_spz(original) if found.compares_spz else None
    rows = [
        figures_of(ORIGINAL, original, size, engine, views),
        figures_of(SPZ, spz.scene, spz.bytes, engine, views) if spz else Figures(SPZ, len(original), None),
    ]
    for candidate in sorted(found.candidates, key=lambda each: each.megabytes, reverse=True):
        name = CHOSEN if candidate is found.chosen else TRIED
        rows.append(figures_of(name, candidate.scene, len(candidate.contents), engine, views))
    return rows


def print_figures(console: Terminal, rows: list[Figures], views: Views) -> None:
    """Print the table, and on which of the views of the compression its figures of quality are."""
    original = rows[0].megabytes
    header = ("file", "Gaussians", "MB", "smaller by", "PSNR (dB)", "SSIM")
    print_table(console, header, [_cells(row, original) for row in rows])
    if views.reported:
        photographs = "held-out photographs, which took no part in decisions"
        what = photographs if views.photographs else "renderings of the original"
        console.say(f"PSNR and SSIM against {len(views.reported)} {what}")


def _cells(row: Figures, original: float | None) -> list[str]:
    """The figures of a file as text; `original` is the size of the original in megabytes."""
    smaller_by = original / row.megabytes if original and row.megabytes else None
    figures = (_cell(row.megabytes, 3), _cell(smaller_by, 1), _cell(row.psnr, 2), _cell(row.ssim, 4))
    return [row.name, f"{row.gaussians:,}", *figures]


def _cell(value: float | None, digits: int) -> str:
    return "n/a" if value is None else f"{value:.{digits}f}"


def closing_lines(found: Compressed, output: Path) -> list[str]:
    """What was written, and whether it is what was asked for."""
    lines = [f"{found.chosen.count:,} Gaussians in {output}, {len(found.chosen.contents):,} bytes"]
    if found.interrupted:
        lines.append("stopped early: this is the best file so far")
    if not found.within_bound:
        lines.append("warning: no file within the bound of quality was found; this is the best one")
    return lines
