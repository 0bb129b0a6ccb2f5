"""Tables of figures on the terminal, which a narrow one does not cut."""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from pocketgs.cli.terminal import Terminal, printable

NARROWEST_NAME = 8
"""Columns of the terminal that names have at least; longer ones are folded where there is no room."""


def print_table(console: Terminal, header: Sequence[str], *sections: Sequence[Sequence[str]]) -> None:
    """Print rows of a name and its figures. Names and titles are folded where there is no room; figures stay whole.

    Args:
        console: to print on.
        header: a title for each column.
        sections: rows, with a line between sections.
    """
    rows = [[printable(cell) for cell in row] for section in sections for row in section]
    last_ones = [sum(map(len, sections[:count])) for count in range(1, len(sections))]
    table = Table()
    for place, title in enumerate(header):
        widest = max((cell_len(row[place]) for row in rows), default=0)
        narrowest = widest if place else min(widest, NARROWEST_NAME)
        table.add_column(title, overflow="fold", min_width=narrowest)
    for number, row in enumerate(rows, start=1):
        table.add_row(*map(Text, row), end_section=number in last_ones)
    # What is wider than the terminal all the same is not cropped: the terminal breaks its lines.
    console.print(table, soft_wrap=False, crop=False)
