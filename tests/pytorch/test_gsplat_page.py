"""The examples in docs/gsplat.md run."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from documentation import ROOT

PAGE = (ROOT / "docs" / "gsplat.md").read_text(encoding="utf-8")
TRAINER, POSE, INSTALLED, REARRANGED = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def numbers(pattern: str, printed: str) -> list[float]:
    return [float(number) for number in re.findall(pattern, printed)]


def test_the_trainer_learns(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(TRAINER.strip().splitlines()) <= 45
    exec(TRAINER, {})
    errors = numbers(r"mean squared error ([\d.]+)", capsys.readouterr().out)
    assert errors[-1] < 0.3 * errors[0]


def test_the_camera_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    exec(POSE, {})
    distances = numbers(r"off by ([\d.]+)", capsys.readouterr().out)
    assert distances[0] > 0.09
    assert distances[-1] < 0.05 * distances[0]


def test_what_is_installed_and_rearranged_runs() -> None:
    subprocess.run([sys.executable, "-c", INSTALLED + REARRANGED], check=True)
