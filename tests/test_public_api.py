"""The names in `import pocketgs`."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import sys
import pocketgs
assert "numba" not in sys.modules, "importing the package loads an engine"
for name in pocketgs.__all__:
    first, second = getattr(pocketgs, name), getattr(pocketgs, name)
    assert callable(first), name
    assert first is second, f"{name} is {second} when it is used again"
"""


def test_names_stay_what_they_are() -> None:
    result = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
