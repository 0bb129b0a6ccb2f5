"""A run as the commands show it: live on the terminal and, if asked for, on a page; then what came of it."""

from __future__ import annotations

from collections.abc import Callable

from pocketgs.cli.display import Display, print_result
from pocketgs.cli.terminal import Terminal
from pocketgs.cli.view import FollowOptions, following
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult


def show_run(
    console: Terminal,
    work: Callable[[Reporter], RunResult],
    page: FollowOptions,
    title: str,
    closing_line: str | None = None,
) -> None:
    """Run, tell the terminal and the page of it, and print the result.

    Args:
        console: the terminal.
        work: the run, given whom to report to.
        page: whether and where a page follows it.
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
