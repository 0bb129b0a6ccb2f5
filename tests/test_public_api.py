"""The names in `import pocketgs`, and the README's example of them."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import pocketgs
from documentation import ROOT
from pocketgs import Capture, Gaussians

PROGRAM = """
import sys
import pocketgs
assert "numba" not in sys.modules, "importing the package loads an engine"
for name in pocketgs.__all__:
    first, second = getattr(pocketgs, name), getattr(pocketgs, name)
    assert callable(first), name
    assert first is second, f"{name} is {second} when it is used again"
"""


TYPES_OF_ARGUMENTS = ("AdamSettings", "EngineOptions", "LearningRates", "Lens", "LossSettings", "TrainingOptions")


def test_names_stay_what_they_are() -> None:
    result = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_what_arguments_are_made_of_is_exported() -> None:
    assert set(TYPES_OF_ARGUMENTS) <= set(pocketgs.__all__)
    assert "render_all" in pocketgs.__all__
    assert pocketgs.__version__ == version("pocketgs")


def test_the_readmes_example(small_capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a small capture, for a few iterations; its background is the rendering's."""
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    capture = replace(small_capture, background=(1.0, 1.0, 1.0))
    monkeypatch.setattr(pocketgs, "open_capture", lambda *_, **__: capture)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(example.replace("train(capture)", "train(capture, iterations=5)"), names)
    scene, prepared = names["scene"], names["capture"]
    assert isinstance(scene, Gaussians)
    assert isinstance(prepared, Capture)
    assert len(Gaussians.load(tmp_path / "fern.ply")) == len(scene)
    expected = pocketgs.render(scene, prepared.held_out[0].camera, (1.0, 1.0, 1.0)).image
    np.testing.assert_array_equal(names["image"], expected)
    assert not np.array_equal(expected, pocketgs.render(scene, prepared.held_out[0].camera).image)
