"""Handling of Ctrl-C and SIGTERM, at once or deferred."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

STOPPED = 130
"""Exit status of a command ended by Ctrl-C, as in shells."""

Handler = Callable[[int, FrameType | None], None]


def listen(handler: Handler) -> dict[signal.Signals, signal.Handlers | Handler | int | None]:
    """Install a handler for Ctrl-C and SIGTERM.

    Ignored signals stay ignored: `nohup` and background jobs of shell scripts ignore them, so that Ctrl-C in the
    terminal does not end them.

    Returns:
        The previous handler by signal, for the signals that have changed.
    """
    heard = [each for each in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(each) is not signal.SIG_IGN]
    return {number: signal.signal(number, handler) for number in heard}


def raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Signal handler that raises KeyboardInterrupt."""
    raise KeyboardInterrupt


AGAIN_AFTER = 0.01
"""Seconds after which an interrupt that was lost is raised again."""


def raise_lost_interrupts() -> None:
    """Raise KeyboardInterrupt again where Python could only print it.

    An exception ends with a function that C code calls. While kernels are compiled, LLVM calls one for every kernel,
    and what was pressed during the seconds before that is raised there.
    """
    before = sys.unraisablehook

    def hook(unraisable: sys.UnraisableHookArgs) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            before(unraisable)
            return
        # Later, and not from here, where it would be lost too.
        number = signal.SIGTERM if signal.getsignal(signal.SIGINT) is signal.SIG_IGN else signal.SIGINT
        timer = threading.Timer(AGAIN_AFTER, _thread.interrupt_main, (number,))
        timer.daemon = True
        timer.start()

    sys.unraisablehook = hook


class Interrupt:
    """Whether a stop was requested, by Ctrl-C or by setting `requested`."""

    requested = False


@contextmanager
def deferred_interrupt() -> Iterator[Interrupt]:
    """Record the first Ctrl-C (or SIGTERM) instead of raising; the second raises KeyboardInterrupt.

    Only the main thread receives signals; elsewhere only code can request a stop.
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
            # None means a handler that was not set from Python.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
