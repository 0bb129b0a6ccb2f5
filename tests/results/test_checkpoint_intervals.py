"""Intervals between checkpoints, by a clock that steps and writing advance."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pocketgs.errors import PocketGSError
from pocketgs.results import checkpoint
from pocketgs.results.checkpoint import CheckpointSaver

STEP = 0.5


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., list[float]]:
    """A function that trains for an hour and returns when checkpoints were begun; writing one takes `seconds`."""

    def train(seconds: float, fails: bool = False) -> list[float]:
        now, begun, warnings = 0.0, [], []

        def write(*_: object) -> None:
            nonlocal now
            begun.append(now)
            now += seconds
            if fails:
                raise PocketGSError("no space left")

        monkeypatch.setattr(checkpoint, "write_checkpoint", write)
        monkeypatch.setattr(checkpoint, "time", SimpleNamespace(monotonic=lambda: now))
        saver = CheckpointSaver(tmp_path, {}, warnings.append)
        progress: Any = SimpleNamespace(checkpoint=lambda: None)
        while now < 3600.0:
            now += STEP
            saver.observe(progress)
        assert len(warnings) == (len(begun) if fails else 0)
        return begun

    return train


@pytest.mark.parametrize("fails", [False, True])
def test_there_is_one_checkpoint_a_minute(written: Callable[..., list[float]], fails: bool) -> None:
    begun = written(2.0, fails)
    assert begun == [60.0 + 62.0 * count for count in range(len(begun))]
    assert len(begun) == 58


@pytest.mark.parametrize("seconds", [30.0, 61.0, 300.0])
def test_a_slow_disk_takes_less_than_a_tenth_of_the_time(written: Callable[..., list[float]], seconds: float) -> None:
    begun = written(seconds)
    assert begun == [60.0 + 11 * seconds * count for count in range(len(begun))]
    assert len(begun) * seconds < 3600.0 / 11 + seconds
