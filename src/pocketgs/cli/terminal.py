"""Terminal output. Control characters are printed as escapes."""

from __future__ import annotations

import os
import sys
import unicodedata
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

STEERING = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories of control characters, direction marks, line breaks, and surrogates."""


WIDTH_OF_FILES = 200
"""Columns of tables in files and pipes, which have no width of their own."""


def printable(text: str) -> str:
    r"""The text with control characters escaped, such as \x1b.

    File names may contain any character, and often come from strangers.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(_escaped(char) if unicodedata.category(char) in STEERING else char for char in text)


def _escaped(char: str) -> str:
    return char.encode("unicode_escape", "surrogatepass").decode("ascii")


class Terminal(Console):
    """Prints text literally: no markup, no highlighting of numbers, no control characters.

    Args:
        to_errors: print to standard error.
    """

    def __init__(self, *, to_errors: bool = False) -> None:
        super().__init__(stderr=to_errors, markup=False, highlight=False, emoji=False, soft_wrap=True)
        if not self.is_terminal and "COLUMNS" not in os.environ:
            self.width = WIDTH_OF_FILES
        # Characters that the terminal's encoding lacks are printed as escapes.
        stream = sys.stderr if to_errors else sys.stdout
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def say(self, *lines: str, style: str | None = None) -> None:
        """Print lines; a line break inside a name does not start a new line."""
        for line in lines:
            self.print(printable(line), style=style)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Escape control characters in everything that is printed, drawn or redrawn."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                shown = "\n".join(map(printable, segment.text.split("\n")))
                yield Segment(shown, segment.style)
