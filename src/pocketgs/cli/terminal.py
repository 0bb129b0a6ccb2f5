"""The one place that text passes on its way to the terminal: what would steer a terminal is shown, not sent."""

from __future__ import annotations

import sys
import unicodedata
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

STEERING = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode's categories of what moves the cursor, turns text around or breaks lines, and of halves of characters."""


def printable(text: str) -> str:
    r"""The text with every character that would steer a terminal written as its escape, such as \x1b.

    File names may hold any character, and often come from strangers.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(_escaped(char) if unicodedata.category(char) in STEERING else char for char in text)


def _escaped(char: str) -> str:
    return char.encode("unicode_escape", "surrogatepass").decode("ascii")


class Terminal(Console):
    """Prints text as it is: names in it are neither markup, nor numbers to colour, nor commands to the terminal.

    Args:
        to_errors: print to standard error.
    """

    def __init__(self, *, to_errors: bool = False) -> None:
        super().__init__(stderr=to_errors, markup=False, highlight=False, emoji=False, soft_wrap=True)
        # A terminal of another encoding gets escapes in place of what it lacks.
        stream = sys.stderr if to_errors else sys.stdout
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def say(self, *lines: str, style: str | None = None) -> None:
        """Print lines; one that a name would break in two stays one."""
        for line in lines:
            self.print(printable(line), style=style)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Everything that is printed, drawn or redrawn comes by here."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                shown = "\n".join(map(printable, segment.text.split("\n")))
                yield Segment(shown, segment.style)
