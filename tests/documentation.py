"""Commands and tables in README and docs."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pocketgs.cli import SUBCOMMANDS

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))

TYPED = re.compile(r"^(?:    |\t)(?P<line>(?:[\w./\\-]*pocketgs|python3?|make|pip)\s.*)$", re.MULTILINE)
IN_TEXT = re.compile(r"`(?P<line>[^`\n]+(?:\n[^`\n]+)?)`")
PROGRAM = r"[\w./\\-]*pocketgs|python3?|make|pip|(bench|tools|tests)/[\w/]+\.py"
STARTS = re.compile(rf"({PROGRAM})\s+\S|({'|'.join(SUBCOMMANDS)})\s.*--")
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Command:
    """A command as a page states it: `program` is pocketgs, make, pip or the path of a script.

    Attributes:
        where: the page and line.
        program: what is called.
        arguments: what it is given.
        typed: whether it stands on a line of its own, to be copied, and not in a sentence.
    """

    where: str
    program: str
    arguments: tuple[str, ...]
    typed: bool

    def __str__(self) -> str:
        return f"{self.where} {self.program} {shlex.join(self.arguments)}"


@dataclass(frozen=True)
class Table:
    """A table, and the paragraph before it."""

    where: str
    before: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def commands() -> list[Command]:
    """All commands of all pages, in order."""
    return [command for page in PAGES for command in _commands_of(page)]


def options() -> list[tuple[str, str]]:
    """Options that sentences name without a command, each with the page: `--seeds balls`."""
    spans = ((page, match["line"]) for page in PAGES for match in IN_TEXT.finditer(page.read_text(encoding="utf-8")))
    return [(page.name, " ".join(line.split())) for page, line in spans if line.startswith("--")]


def tables() -> list[Table]:
    """All tables of all pages."""
    return [table for page in PAGES for table in _tables_of(page)]


def _commands_of(page: Path) -> Iterator[Command]:
    text = page.read_text(encoding="utf-8")
    shells = "".join(block for kind, block in FENCED.findall(text) if kind in ("", "sh", "bash", "console"))
    # Blocks in other languages have lines that look like commands.
    plain = FENCED.sub(lambda block: "\n" * block[0].count("\n"), text)
    plain += "\n" + re.sub(r"^(\$ )?", "    ", shells, flags=re.MULTILINE)
    for pattern in (TYPED, IN_TEXT):
        for match in pattern.finditer(plain):
            line = " ".join(match["line"].split()) if pattern is IN_TEXT else match["line"]
            if pattern is TYPED or STARTS.match(line):
                where = f"{page.name}:{plain.count(chr(10), 0, match.start()) + 1}"
                yield from _split(where, line, pattern is TYPED)


def _split(where: str, line: str, typed: bool) -> Iterator[Command]:
    for part in line.split("&&"):
        program, *arguments = shlex.split(part.replace("\\", "/"), comments=True)
        name = program.rpartition("/")[2]
        if name.startswith("python") and arguments and arguments[0].endswith(".py"):
            yield Command(where, arguments[0], tuple(arguments[1:]), typed)
        elif program in SUBCOMMANDS:
            yield Command(where, "pocketgs", (program, *arguments), typed)
        else:
            yield Command(where, program if program.endswith(".py") else name, tuple(arguments), typed)


def _tables_of(page: Path) -> Iterator[Table]:
    blocks = re.split(r"\n\s*\n", page.read_text(encoding="utf-8"))
    for before, block in zip(["", *blocks], blocks, strict=False):
        lines = [line.strip() for line in block.strip().splitlines()]
        if len(lines) > 2 and all(line.startswith("|") for line in lines) and set(lines[1]) <= set("|-: "):
            header, _, *rows = (tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines)
            yield Table(page.name, " ".join(before.split()), header, tuple(rows))
