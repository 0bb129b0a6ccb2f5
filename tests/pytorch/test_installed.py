"""The packages for these tests are installed, and PocketGS does not import them otherwise."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

from missing import unavailable
from pocketgs.extras import how_to_install

IMPORT_ALL = """
import sys
import pocketgs
for name in pocketgs.__all__:
    getattr(pocketgs, name)
assert "torch" not in sys.modules
"""


@pytest.mark.parametrize("name", ["torch", "gsplat"])
def test_what_the_tests_of_pytorch_functions_need_is_there(name: str) -> None:
    if importlib.util.find_spec(name) is None:
        unavailable(f"no {name}: {how_to_install('gsplat')}; the tests of pocketgs.torch are left out")


def test_importing_the_package_does_not_import_pytorch() -> None:
    subprocess.run([sys.executable, "-c", IMPORT_ALL], check=True)
