"""Ctrl-C, and SIGTERM which means the same here; and how they wait for a good moment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

STOPPED = 130
"""Exit status of a command that Ctrl-C has ended, as shells have it."""

Handler = Callable[[int, FrameType | None], None]


def listen(handler: Handler) -> dict[signal.Signals, signal.Handlers | Handler | int | None]:
    """Have a handler called on Ctrl-C and SIGTERM.

    What is ignored stays ignored: `nohup` starts commands like that, and shell scripts their jobs in the background, so
    that Ctrl-C in the terminal does not end them.

    Returns:
        What was called before, by signal, where that has changed.
    """
    heard = [each for each in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(each) is not signal.SIG_IGN]
    return {number: signal.signal(number, handler) for number in heard}


def raise_interrupt(number: int, frame: FrameType | None) -> None:
    """A handler that raises KeyboardInterrupt."""
    raise KeyboardInterrupt


class Interrupt:
    """Whether somebody has asked to stop: the user by Ctrl-C, or whoever sets `requested`."""

    requested = False


@contextmanager
def deferred_interrupt() -> Iterator[Interrupt]:
    """Note the first Ctrl-C (or SIGTERM) instead of raising it; the second raises KeyboardInterrupt.

    Only the main thread receives signals: elsewhere only others can request it.
    """
    interrupt = Interrupt()
    pressed = False
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt
        pressed = interrupt.requested = True

    before = listen(note)
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            # None stands for a handler that was not set from Python.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
