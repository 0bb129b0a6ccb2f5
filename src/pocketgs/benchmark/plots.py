"""The charts of a report: quality against time, time by stage, memory over time.

The same results give the same bytes.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pocketgs.benchmark.aggregate import STAGES, captures_of, mean_of, method_order, rows_of, stage_seconds, stages_of
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.results import CellResult
from pocketgs.benchmark.series import Curve, Trace, curves, mean_curve, traces
from pocketgs.errors import PocketGSError
from pocketgs.extras import how_to_install
from pocketgs.files.atomic_file import replacing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.container import BarContainer

METHOD_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#7a7a7a", "#56b4e9")
"""Colours that remain distinct with colour blindness (Okabe and Ito, 2008), with grey for black, which text has."""

MARKERS = "os^DvPX*<>"
"""More than there are colours: methods that share a colour differ in marker and dashes."""

STAGE_COLOURS = ("#dddddd", "#77aadd", "#bbcc33", "#ffaabb", "#ee8866", "#eedd88", "#99ddff", "#44bb99")
"""The scheme "light" (Tol, 2021), on which black text is readable."""

INK, FAINT = "#111111", "#c8c8c9"
"""Colours of text and axes, and of the grid; a page replaces them by its own."""

WIDTH = 4.8
"""Width of a chart in inches at 72 points: about a phone's width, so that text keeps its size."""

STYLE: dict[Any, Any] = {
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 11,
    "font.family": "sans-serif",
    "font.size": 10,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "pocketgs",
    "text.color": INK,
    # Names are literal, even with dollar signs in them.
    "text.parse_math": False,
    "xtick.color": INK,
    "ytick.color": INK,
}


@contextmanager
def _style() -> Iterator[None]:
    """Set Matplotlib's style for the charts, and restore the user's afterwards."""
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise PocketGSError(f"charts need matplotlib ({error}): {how_to_install('bench')}") from error
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def colour_of(method: str) -> str:
    """A method's colour, "#rrggbb", the same in all charts."""
    return METHOD_COLOURS[_place(method) % len(METHOD_COLOURS)]


def _line_style(method: str) -> dict[str, Any]:
    """Colour, marker and dashes of a method's lines, a unique combination."""
    place = _place(method)
    dashes = "-" if place < len(METHOD_COLOURS) else (0, (4, 1.5))
    return {"color": colour_of(method), "marker": MARKERS[place % len(MARKERS)], "linestyle": dashes}


def _place(method: str) -> int:
    place, name = method_order(method)
    # Unlisted methods get a colour by name, independent of the other methods.
    return place if method in METHODS else sum(name.encode())


def curves_svg(results: Sequence[CellResult], capture: str) -> str | None:
    """Held-out PSNR against time on a capture, as SVG; None if no run was evaluated during training."""
    found = curves(results, capture)
    if not found:
        return None
    ends = [f"{method} {mean_curve(seeds)[-1].psnr:.2f} dB" for method, seeds in found.items() if mean_curve(seeds)]
    label = f"Held-out PSNR against seconds on {capture}, at the end: {', '.join(ends)}"
    return _svg(lambda axes: _draw_curves(axes, found), 2.9, label)


def stages_svg(results: Sequence[CellResult], capture: str) -> str | None:
    """Seconds by stage of each method on a capture, as SVG; None if no run recorded them."""
    seconds: dict[str, dict[str, float]] = {}
    for row in rows_of(results, capture):
        stages = [stage_seconds(result) for result in row.results]
        means = {name: mean_of(found.get(name) for found in stages) for name in stages_of(row.results)}
        if means:
            seconds[row.method] = {name: mean.value for name, mean in means.items() if mean}
    if not seconds:
        return None
    totals = [f"{method} {sum(stages.values()):.1f} s" for method, stages in seconds.items()]
    label = f"Seconds by stage on {capture}, in total: {', '.join(totals)}"
    return _svg(lambda axes: _draw_stages(axes, seconds), 0.8 + 0.32 * len(seconds), label)


def memory_svg(results: Sequence[CellResult], capture: str) -> str | None:
    """Memory over time of one run of each method on a capture, as SVG; None if no run recorded it."""
    found = traces(results, capture)
    if not found:
        return None
    label = f"Resident memory against seconds on {capture}, peaks: {', '.join(map(_peak, found, found.values()))}"
    return _svg(lambda axes: _draw_memory(axes, found), 2.9, label)


def write_overview(results: Sequence[CellResult], path: Path) -> None:
    """Write an image of quality against time, one chart per capture; without results, remove an earlier one.

    Args:
        results: in any order; failed ones are left out.
        path: of the image, a `.png`.

    Raises:
        PocketGSError: matplotlib is missing, or the file cannot be written.
    """
    found = {name: by_method for name in captures_of(results) if (by_method := curves(results, name))}
    if not found:
        path.unlink(missing_ok=True)
        return
    with _style():
        from matplotlib.figure import Figure

        columns = min(2, len(found))
        lines = math.ceil(len(found) / columns)
        figure = Figure((5.2 * columns, 3.2 * lines + 0.4), layout="constrained")
        shown: dict[str, Artist] = {}
        for place, (capture, by_method) in enumerate(found.items(), start=1):
            axes = figure.add_subplot(lines, columns, place, title=capture)
            shown |= _draw_curves(axes, by_method)
        methods = sorted(shown, key=method_order)
        figure.legend(
            [shown[name] for name in methods], methods, loc="outside lower center", ncols=min(4, len(methods))
        )
        with replacing(path) as partial:
            figure.savefig(partial, format="png", dpi=144, metadata={"Software": None})


def _draw_curves(axes: Axes, by_method: dict[str, list[Curve]]) -> dict[str, Artist]:
    """Draw each method's mean over seeds, and its seeds as thin lines; returns legend entries by method."""
    handles: dict[str, Artist] = {}
    for method, seeds in by_method.items():
        if len(seeds) > 1:
            for curve in seeds:
                seconds, psnr = [it.seconds for it in curve], [it.psnr for it in curve]
                axes.plot(seconds, psnr, color=colour_of(method), linewidth=0.7, alpha=0.7)
        mean = mean_curve(seeds)
        seconds, psnr = [it.seconds for it in mean], [it.psnr for it in mean]
        (handles[method],) = axes.plot(seconds, psnr, markersize=4, linewidth=1.6, **_line_style(method))
    axes.set_xlim(left=0)
    axes.grid()
    axes.set_xlabel("seconds since the command began")
    axes.set_ylabel("held-out PSNR (dB)")
    return handles


def _draw_stages(axes: Axes, seconds: dict[str, dict[str, float]]) -> dict[str, Artist | BarContainer]:
    """Draw one bar per method, divided into stages; returns legend entries by stage."""
    handles: dict[str, Artist | BarContainer] = {}
    longest = max(sum(stages.values()) for stages in seconds.values())
    found = {stage for stages in seconds.values() for stage in stages}
    colours = dict(zip((*STAGES, *sorted(found - STAGES.keys())), (*STAGE_COLOURS, *STAGE_COLOURS), strict=False))
    for line, stages in enumerate(seconds.values()):
        start = 0.0
        for stage, value in stages.items():
            bar = axes.barh(line, value, 0.72, start, color=colours[stage], edgecolor=INK, linewidth=0.4)
            handles.setdefault(stage, bar)
            if value > 0.09 * longest:
                axes.text(start + value / 2, line, f"{value:.1f}", ha="center", va="center", color="black", size=8)
            start += value
        axes.text(start + 0.01 * longest, line, f"{start:.1f}", va="center", weight="bold", size=9)
    axes.set_yticks(range(len(seconds)), list(seconds))
    axes.set_ylim(len(seconds) - 0.5, -0.5)
    axes.set_xlim(0, 1.12 * longest)
    axes.set_xlabel("seconds")
    return handles


def _draw_memory(axes: Axes, by_method: dict[str, Trace]) -> dict[str, Artist]:
    """Draw one line per method with a mark at its peak; returns legend entries by method."""
    handles: dict[str, Artist] = {}
    for method, trace in by_method.items():
        peak = max(trace, key=lambda sample: sample.rss_mb)
        seconds, megabytes = [it.seconds for it in trace], [it.rss_mb for it in trace]
        mark = [seconds.index(peak.seconds)]
        (line,) = axes.plot(seconds, megabytes, linewidth=1.2, markersize=6, markevery=mark, **_line_style(method))
        handles[_peak(method, trace)] = line
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid()
    axes.set_xlabel("seconds since the command began")
    axes.set_ylabel("resident memory (MB)")
    return handles


def _peak(method: str, trace: Trace) -> str:
    peak = max(trace, key=lambda sample: sample.rss_mb)
    return f"{method} {peak.rss_mb:.0f} MB, {peak.stage}"


def _svg(draw: Callable[[Axes], Mapping[str, Any]], height: float, label: str) -> str:
    """A chart with its legend below it as an `<svg>` element.

    Args:
        draw: draws on axes and returns the legend entries by name.
        height: of the chart in inches, without its legend.
        label: text description, for screen readers.
    """
    with _style():
        from matplotlib.figure import Figure

        figure = Figure(layout="constrained")
        handles = draw(figure.add_subplot())
        # As many columns as fit: a sample takes 30 points, a letter of its name 4.5 on average.
        columns = min(len(handles), max(1, int(72 * WIDTH / (30 + 4.5 * max(map(len, handles))))))
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=columns)
        figure.set_size_inches(WIDTH, height + 0.19 * math.ceil(len(handles) / columns))
        written = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(written, format="svg", transparent=True, metadata=nothing)
    return _for_page(written.getvalue(), label)


def _for_page(svg: str, label: str) -> str:
    """Convert an SVG file to an element of a page: with the page's colours, a text label, and unique ids."""
    element = svg[svg.index("<svg") :]
    # A page needs no namespaces, and its own style defines line joins.
    element = re.sub(
        r'<!--.*?-->|<metadata.*?</metadata>|<style.*?</style>| xmlns\S*="\S*"', "", element, flags=re.DOTALL
    )
    element = element.replace(INK, "currentColor").replace(FAINT, "var(--faint)")
    # Ids must differ between the charts of a page, or one chart would be clipped as another.
    own = "c" + sha256(label.encode()).hexdigest()[:8]
    element = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{own}-", element)
    return element.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1)
