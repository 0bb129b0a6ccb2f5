"""Showing a run on the terminal and, if requested, on a page; then printing its result."""

from __future__ import annotations

from collections.abc import Callable

from pocketgs.cli.display import Display
from pocketgs.cli.page import FollowOptions, following
from pocketgs.cli.run_result import print_result
from pocketgs.cli.terminal import Terminal
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult


def show_run(
    console: Terminal,
    work: Callable[[Reporter], RunResult],
    page: FollowOptions,
    title: str,
    closing_line: str | None = None,
) -> None:
    """Run, show progress on the terminal and the page, and print the result.

    Args:
        console: the terminal.
        work: the run; called with a reporter.
        page: options of the page.
        title: of the page.
        closing_line: printed after the result.

    Raises:
        PocketGSError: the page cannot be served, or what the run raises.
    """
    display = Display(console)
    with following(page, title) as followed:
        with display.showing() as shown:
            result = work(followed.reporter(shown) if followed else shown)
        if followed:
            followed.finish(result)
        print_result(console, result)
        if closing_line:
            console.say(closing_line)
