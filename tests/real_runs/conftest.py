"""Runs on real captures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from real_runs.commands import succeeds


@pytest.fixture
def trained(data_folder: Path, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """A function that trains on a capture with some options, and returns the run's record."""

    def train(name: str | Path, *options: object) -> dict[str, Any]:
        output = tmp_path / Path(name).name
        succeeds("train", data_folder / name, "--output", output, *options)
        return dict(json.loads((output / "run.json").read_text()))

    return train
