"""The result of a run on the terminal: quality of the held-out views, time and memory."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

from pocketgs.cli.figure_table import print_table
from pocketgs.cli.terminal import Terminal, printable
from pocketgs.errors import counted
from pocketgs.metrics.evaluation import Evaluation, ImageMetrics
from pocketgs.results.run import RunResult


def print_result(console: Terminal, result: RunResult) -> None:
    """Print quality, time and memory of a run, and the path of its result."""
    summary = result.summary
    if result.evaluation:
        contradicted = summary["contradicted_views"]
        print_evaluation(console, result.evaluation, contradicted["names"] if contradicted else ())
    seconds = summary["seconds"]
    stages = ", ".join(f"{name} {value:.1f}" for name, value in seconds.items() if name != "total" and value >= 0.05)
    stopped = " (stopped early)" if summary["interrupted"] else ""
    buffers = sum(summary["engine_bytes"].values()) / 1e6
    engine = f"engine {summary['engine']} ({summary['device']}), its buffers {buffers:.0f} MB"
    lines = [
        f"{summary['iterations']} iterations{stopped}, {summary['gaussians']:,} Gaussians, {engine}",
        f"{seconds['total']:.1f} s in total ({stages}), peak memory {summary['peak_rss_mb']:.0f} MB",
        f"result in {result.folder}: scene.ply, run.json{', held_out/' if result.evaluation else ''}",
    ]
    moved = summary["transients"]
    if moved and moved["photographs"]:
        share = f"on average {moved['share']:.1%} of a photograph is left out, see transients/"
        shown = counted(moved["photographs"], "photograph shows", "photographs show")
        lines.insert(0, f"{shown} things that moved: {share}")
    if moved and moved["left_out"]:
        left_out = counted(len(moved["left_out"]), "photograph contradicts", "photographs contradict")
        names = ", ".join(printable(name) for name in moved["left_out"])
        lines.insert(0, f"{left_out} the others, left out of training (a wrong pose, or another place?): {names}")
    console.say(*lines)


@dataclass(frozen=True)
class Column:
    """A figure in the table of held-out views.

    Attributes:
        name: of the figure in `ImageMetrics` and `Evaluation`.
        title: of its column.
        decimals: that are shown.
    """

    name: str
    title: str
    decimals: int

    def text_of(self, metrics: ImageMetrics | Evaluation) -> str:
        """The figure, or that there is none."""
        value = getattr(metrics, self.name)
        return "n/a" if value is None else f"{value:.{self.decimals}f}"


COLUMNS = (
    Column("psnr", "PSNR (dB)", 2),
    Column("cc_psnr", "colour-corrected", 2),
    Column("ssim", "SSIM", 4),
    Column("flip", "FLIP", 4),
    Column("lpips", "LPIPS", 4),
)


def print_evaluation(console: Terminal, evaluation: Evaluation, apart: Collection[str] = ()) -> None:
    """Print a table of metrics per image by name, with means.

    Args:
        console: to print on.
        evaluation: of the held-out views.
        apart: names of views whose given poses are contradicted; there is a second mean, without them.
    """
    columns = [column for column in COLUMNS if getattr(evaluation, column.name) is not None]
    images = sorted(evaluation.images, key=lambda image: _numbered(image.name))
    means = {"mean": evaluation}
    if others := evaluation.without(apart) if apart else None:
        means[f"without {len(apart)} with contradicted poses"] = others
    print_table(
        console,
        ["held-out view", *(column.title for column in columns)],
        [[image.name, *(column.text_of(image) for column in columns)] for image in images],
        [[name, *(column.text_of(mean) for column in columns)] for name, mean in means.items()],
    )
    if evaluation.lpips_note:
        console.say(evaluation.lpips_note, style="dim")


def _numbered(name: str) -> list[tuple[str, int]]:
    """A key that sorts r_2.png before r_10.png."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", name)]
