"""Ctrl-C that is deferred: the first is recorded, the second raised, whoever else requests a stop; or nearly lost."""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
import time

import pytest

from pocketgs.system.interrupt import deferred_interrupt, raise_lost_interrupts


def test_the_first_is_noted_and_the_second_raised() -> None:
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupt() as interrupt:
        assert not interrupt.requested
        signal.raise_signal(signal.SIGINT)
        assert interrupt.requested
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_what_is_ignored_stays_so() -> None:
    """As in a shell script's background job: Ctrl-C in the terminal is not for it."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupt() as interrupt:
            signal.raise_signal(signal.SIGINT)
            assert not interrupt.requested
            signal.raise_signal(signal.SIGTERM)
            assert interrupt.requested
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_request_by_somebody_else_is_no_ctrl_c() -> None:
    with deferred_interrupt() as interrupt:
        interrupt.requested = True
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_other_threads_can_be_asked_to_stop_only_by_others() -> None:
    seen = []

    def work() -> None:
        with deferred_interrupt() as interrupt:
            seen.append(interrupt.requested)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]


@pytest.mark.parametrize("ignored", [None, signal.SIGINT])
def test_ctrl_c_in_a_function_that_c_calls_is_not_lost(
    monkeypatch: pytest.MonkeyPatch, ignored: signal.Signals | None
) -> None:
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    raise_lost_interrupts()
    number = signal.SIGTERM if ignored else signal.SIGINT
    called_by_c = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(number))
    before = {each: signal.signal(each, signal.default_int_handler) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        if ignored:
            signal.signal(ignored, signal.SIG_IGN)
        called_by_c()  # Python can raise nothing here
        with pytest.raises(KeyboardInterrupt):
            time.sleep(10)
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def test_other_errors_in_a_function_that_c_calls_are_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda unraisable: printed.append(unraisable.exc_type))
    raise_lost_interrupts()
    ctypes.CFUNCTYPE(None)(lambda: [].pop())()
    assert printed == [IndexError]
