"""The content of the report as text tables, independent of Markdown and HTML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pocketgs.benchmark import published
from pocketgs.benchmark.aggregate import (
    BASELINE,
    FIGURES,
    FLIP,
    LPIPS,
    PSNR,
    SECONDS,
    SSIM,
    Figure,
    Mean,
    Row,
    captures_of,
    difference,
    in_order,
    methods_of,
    ratio,
    rows_of,
    stage_seconds,
    stages_of,
)
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.published import FULL, MOBILE_SCAN, Published, reported
from pocketgs.benchmark.results import Cell, CellResult

MISSING = "n/a"
"""A figure that a run should have but does not."""

NONE = "–"
"""A figure that does not apply."""


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: of the table.
        head: of the columns; the first column names the rows.
        rows: each with as many cells as the head.
        notes: for the reader, a sentence or two each.
        quoted: number of last rows that are the source's, not measured here.
        numeric: whether all columns but the first hold numbers.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    quoted: int = 0
    numeric: bool = False


@dataclass(frozen=True)
class Command:
    """The command behind a method on a capture, with its first seed, and the other seeds."""

    cell: Cell
    command: str
    other_seeds: tuple[int, ...]


def summary_table(results: Sequence[CellResult]) -> Table:
    """PSNR of every method on every capture."""
    methods = methods_of(results)
    lines = []
    for capture in captures_of(results):
        rows = {row.method: row for row in rows_of(results, capture)}
        shown = [rows.get(method) for method in methods]
        lines.append((capture, *(_text(row.mean(PSNR.of), ",.2f", row.seeds) if row else NONE for row in shown)))
    return Table("PSNR on held-out views (dB)", ("capture", *methods), tuple(lines), numeric=True)


def figures_table(results: Sequence[CellResult], capture: str) -> Table:
    """All methods' figures on a capture, followed by the source's."""
    rows = rows_of(results, capture)
    sources = published.COMPARISON.get(published.DATASETS.get(capture, ""), ())
    columns = [
        ("method", *(row.method for row in rows), *(f"source: {source.method}" for source in sources)),
        ("runs", *(f"{len(row.results)} of {row.seeds}" for row in rows), *(NONE for _ in sources)),
    ]
    for figure in FIGURES:
        # FLIP and LPIPS have columns even if their packages were missing, to show that they are missing.
        if figure in (FLIP, LPIPS) or any(row.mean(figure.of) for row in rows):
            columns.append(_column(figure, rows, sources))
        if figure is PSNR and len(rows) > 1:
            columns.append((f"Δ {BASELINE}", *_to_baseline(rows), *(NONE for _ in sources)))
    notes = _warnings(rows) + _lpips_notes(rows)
    if any(row.seeds > 1 for row in rows):
        notes.append("Means over seeds ± half the range.")
    notes.append("Time is from the command's start to the written scene, without evaluations on held-out views.")
    notes += [
        f"Peak memory is that of the command's own process; COLMAP's, where {row.method} runs it, is not included."
        for row in rows
        if row.method in METHODS and "colmap" in METHODS[row.method].flags
    ]
    source = published.comparability(capture)
    notes += [source] if source else []
    head, *lines = zip(*columns, strict=True)
    return Table("Figures", head, tuple(lines), tuple(notes), quoted=len(sources), numeric=True)


def _column(figure: Figure, rows: Sequence[Row], sources: Sequence[Published]) -> tuple[str, ...]:
    measured = [_text(row.mean(figure.of), f",.{figure.decimals}f", len(row.results)) for row in rows]
    quoted = [figure.quoted(source) for source in sources]
    return (
        figure.name,
        *measured,
        *(NONE if value is None else f"{value:,.{figure.decimals}f}" for value in quoted),
    )


def _to_baseline(rows: Sequence[Row]) -> list[str]:
    baseline = next((row for row in rows if row.method == BASELINE), None)
    if baseline is None:
        return [MISSING for _ in rows]
    changes = [difference(row, baseline, PSNR) for row in rows]
    return [
        NONE if row is baseline else _text(change, "+.2f", len(row.results))
        for row, change in zip(rows, changes, strict=True)
    ]


def _warnings(rows: Sequence[Row]) -> list[str]:
    """Warnings about runs that had to deviate from their options, with the methods concerned."""
    methods: dict[str, list[str]] = {}
    for row in rows:
        said = (warning for it in row.results for warning in (it.run.get("prior") or {}).get("warnings") or ())
        for warning in dict.fromkeys(map(str, said)):
            methods.setdefault(warning, []).append(row.method)
    return [f"{', '.join(named)}: {warning}." for warning, named in methods.items()]


def _lpips_notes(rows: Sequence[Row]) -> list[str]:
    return sorted({str(note) for row in rows for it in row.results if (note := it.run.get("lpips_note"))})


def stages_table(results: Sequence[CellResult], capture: str) -> Table:
    """Seconds by stage of every method on a capture."""
    rows = [row for row in rows_of(results, capture) if row.results]
    stages = stages_of(result for row in rows for result in row.results)

    def seconds(stage: str) -> Callable[[CellResult], float | None]:
        return lambda result: stage_seconds(result).get(stage)

    cells = (
        (row.method, *(_text(row.mean(seconds(stage)), ",.1f", len(row.results)) for stage in stages)) for row in rows
    )
    note = "Evaluation includes evaluations on held-out views during training."
    return Table("Seconds by stage", ("method", *stages), tuple(cells), (note,), numeric=True)


def differences_table(results: Sequence[CellResult], capture: str) -> Table | None:
    """The source's reported differences beside the measured ones; None if nothing can be compared."""
    dataset = published.DATASETS.get(capture)
    rows = {METHODS[row.method].stands_for: row for row in rows_of(results, capture) if row.method in METHODS}
    if dataset is None or FULL not in rows:
        return None
    pairs = [(FULL, other, dataset) for other in (published.FROM_SPARSE, published.FROM_DENSE)]
    pairs += [(ablation.method, FULL, MOBILE_SCAN) for ablation in published.ABLATIONS]
    cells = [_difference_cells(rows[a], rows[b], where) for a, b, where in pairs if a in rows and b in rows]
    head = ["first − second", "seeds", "source's dataset"]
    for figure in (PSNR, SSIM, LPIPS):
        head += [f"{figure.name}: source", "here"]
    note = "Time is first / second. Differences are means over the seeds that both methods have."
    title = "The source's differences and ours"
    return Table(title, (*head, "time: source", "here"), tuple(cells), (note,), numeric=True) if cells else None


def _difference_cells(first: Row, second: Row, dataset: str) -> tuple[str, ...]:
    names = [METHODS[row.method].stands_for or "" for row in (first, second)]
    theirs = [source for name in names if (source := reported(name, dataset))]
    shared = difference(first, second, PSNR)
    seeds = shared.count if shared else 0
    cells = [" − ".join(names), str(seeds), dataset]
    for figure in (PSNR, SSIM, LPIPS):
        minuend, subtrahend = (figure.quoted(source) or 0.0 for source in theirs)
        cells.append(_signed(minuend - subtrahend, f"+.{figure.decimals}f"))
        cells.append(_text(difference(first, second, figure), f"+.{figure.decimals}f", seeds))
    cells.append(f"{theirs[0].seconds / theirs[1].seconds:.2f}×")
    multiple = ratio(first, second, SECONDS)
    cells.append(f"{multiple.value:.2f}×" if multiple else MISSING)
    return tuple(cells)


def protocol_lines(results: Sequence[CellResult], capture: str) -> list[str]:
    """Protocols of the runs (preparation and split of images, iterations): one line if all agree."""
    cells_by_protocol: dict[str, list[str]] = {}
    for row in rows_of(results, capture):
        for result in row.results:
            cells_by_protocol.setdefault(_protocol(result), []).append(result.cell.name)
    if len(cells_by_protocol) == 1:
        return list(cells_by_protocol)
    return [f"{', '.join(names)}: {protocol}" for protocol, names in cells_by_protocol.items()]


def _protocol(result: CellResult) -> str:
    run, views = result.run, result.run.get("capture") or {}
    return "; ".join(
        (
            str(run.get("protocol", "protocol unknown")),
            f"{views.get('training_views', '?')} training and {views.get('held_out_views', '?')} held-out views",
            f"{run.get('iterations', '?')} iterations" + (", interrupted" if run.get("interrupted") else ""),
            f"engine {run.get('engine', '?')} on {run.get('device', '?')}",
        )
    )


def methods_table(results: Sequence[CellResult]) -> Table:
    """Descriptions of the methods."""
    rows = []
    for name in methods_of(results):
        method = METHODS.get(name)
        flags = (" ".join(method.flags) or "none") if method else "?"
        rows.append((name, method.what if method else "?", flags, (method.stands_for if method else None) or NONE))
    return Table("Methods", ("method", "what it does", "flags", "the source's name"), tuple(rows))


def failures_table(results: Sequence[CellResult]) -> Table | None:
    """Failed runs with their errors; None if none failed. Rows state the number of seeds in their means."""
    rows = [(it.cell.name, " ".join(it.error.split()) or "failed") for it in in_order(results) if it.error is not None]
    return Table("Failed runs", ("run", "why"), tuple(rows)) if rows else None


def machines_table(results: Sequence[CellResult]) -> Table:
    """Machines and versions of the runs: one column per machine or set of versions."""
    groups: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for result in in_order(results):
        if result.error is None:
            versions = result.run.get("versions") or {}
            properties = {**result.machine, **{key: it for key, it in versions.items() if key not in result.machine}}
            key = tuple((str(name), str(value)) for name, value in properties.items())
            groups.setdefault(key, []).append(result.cell.name)
    names = list(dict.fromkeys(name for group in groups for name, _ in group))
    columns = [dict(group) for group in groups]
    heads = ["all runs"] if len(groups) == 1 else [", ".join(cells) for cells in groups.values()]
    rows = tuple((name, *(column.get(name, NONE) for column in columns)) for name in names)
    return Table("Machine and versions", ("", *heads), rows)


def commands(results: Sequence[CellResult]) -> list[Command]:
    """The commands that reproduce the results, one per method and capture."""
    groups: dict[tuple[str, str], list[CellResult]] = {}
    for result in in_order(results):
        groups.setdefault((result.cell.capture, result.cell.method), []).append(result)
    return [
        Command(first.cell, " ".join(first.command.split()), tuple(other.cell.seed for other in others))
        for first, *others in groups.values()
    ]


def _text(mean: Mean | None, style: str, expected: int) -> str:
    """A mean with its spread, and the number of runs if it is not as expected.

    Args:
        mean: or None if there is none.
        style: format of the mean; the spread uses it without "+".
        expected: number of runs.
    """
    if mean is None:
        return MISSING
    spread = f" ± {mean.spread:{style.lstrip('+')}}" if mean.spread > 0 else ""
    missing = f" ({mean.count} of {expected})" if mean.count < expected else ""
    return _signed(mean.value, style) + spread + missing


def _signed(value: float, style: str) -> str:
    return f"{value:{style}}".replace("-", "−")
