"""Where the tests of the WebGPU engine get their device."""

from __future__ import annotations

import os

import pytest

from pocketgs.splat.webgpu.adapters import Adapter, adapters


@pytest.fixture(scope="session")
def adapter() -> Adapter:
    """The best adapter, software ones included; without any the test is skipped, but on CI it fails."""
    if not adapters():
        reason = "no Vulkan, Metal or DX12 adapter: install a driver, such as Mesa's software Vulkan"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return adapters()[0]
