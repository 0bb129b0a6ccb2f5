"""The table of results as a Markdown document. It is deterministic."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pocketgs.benchmark.aggregate import captures_of
from pocketgs.benchmark.results import CellResult
from pocketgs.benchmark.sections import (
    Command,
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

_STARTS = re.compile(r"^(\d*)([-+#>~=.)])")
"""Line starts that Markdown would read as a heading, quotation, rule, fence or list item."""

_SPECIAL = str.maketrans(
    {"\\": "\\\\", "|": "\\|", "<": "&lt;", "*": "\\*", "_": "\\_", "`": "\\`", "[": "\\[", "&": "&amp;"}
)


def markdown_table(results: Sequence[CellResult]) -> str:
    """Format the results as a Markdown document.

    Args:
        results: in any order; some may have failed.

    Returns:
        A heading and tables per capture, failures, machines, and commands.
    """
    parts = ["# Results"]
    failures = failures_table(results)
    parts += _table(failures, "##") if failures else []
    parts += _table(summary_table(results), "##")
    for capture in captures_of(results):
        parts.append(f"## {_plain(capture)}")
        parts += [_paragraph(line) for line in protocol_lines(results, capture)]
        tables = (figures_table, differences_table, stages_table)
        for table in filter(None, (make(results, capture) for make in tables)):
            parts += _table(table, "###")
    parts += [*_table(methods_table(results), "##"), *_table(machines_table(results), "##")]
    parts += ["## Commands", *(_command(command) for command in commands(results))]
    return "\n\n".join(parts) + "\n"


def _table(table: Table, heading: str) -> list[str]:
    """A table as paragraphs: title, rows, and notes; figures quoted from the source are in italics."""
    head = [_plain(name) or " " for name in table.head]
    lines = [head, ["---", *("---:" for _ in head[1:])] if table.numeric else ["---" for _ in head]]
    measured = len(table.rows) - table.quoted
    for index, row in enumerate(table.rows):
        cells = [_plain(cell) for cell in row]
        lines.append(cells if index < measured else [f"*{cell}*" for cell in cells])
    text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return [f"{heading} {_plain(table.title)}", text, *(_paragraph(note) for note in table.notes)]


def _command(command: Command) -> str:
    """A command in an indented code block, which no text can end."""
    seeds = ", ".join(map(str, command.other_seeds))
    more = f"; likewise with seed {seeds}" if seeds else ""
    return f"{_paragraph(command.cell.name)}{more}:\n\n    {command.command}"


def _paragraph(text: str) -> str:
    """Literal text as a paragraph, with all markup escaped, including at its start."""
    return _STARTS.sub(r"\1\\\2", _plain(text))


def _plain(text: str) -> str:
    """Literal text on one line, with Markdown and HTML escaped."""
    return " ".join(text.split()).translate(_SPECIAL)
