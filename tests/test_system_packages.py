"""Installation of system packages for tests, and the messages if it is not allowed. Nothing is installed here."""

from __future__ import annotations

import importlib
import itertools
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

TOOLS = Path(__file__).resolve().parent.parent / "tools"
COMMANDS = [["apt-get", "update", "-q"], ["apt-get", "install", "-q", "-y", "--no-install-recommends", "chromium"]]

Commands = list[list[str]]


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The tool on a Debian that lacks a browser, without continuous integration."""
    monkeypatch.syspath_prepend(str(TOOLS))
    tool = importlib.import_module("system_packages")
    monkeypatch.setattr(tool, "NEEDS", (tool.Need("libvulkan1", "Vulkan", lambda: True), a_browser(tool, False)))
    monkeypatch.setattr(tool, "CERTIFICATES", Path(__file__))
    monkeypatch.setattr(tool.sys, "platform", "linux")
    monkeypatch.delenv("CI", raising=False)
    return tool


def a_browser(tool: ModuleType, *there: bool) -> Any:
    """A need that is or is not there, time after time."""
    answers = iter([*there, *itertools.repeat(there[-1], 10)])
    return tool.Need("chromium", "a browser", lambda: next(answers))


@pytest.fixture
def apt(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Callable[[int], Commands]:
    """A function that runs the tool as root with a fake apt-get of a given status, and returns the calls."""

    def provide(status: int) -> Commands:
        called: Commands = []

        def call(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
            called.append(command)
            return subprocess.CompletedProcess(command, status)

        monkeypatch.setattr(tool, "may_install", lambda: True)
        monkeypatch.setattr(tool.subprocess, "run", call)
        return called

    return provide


def test_root_installs_what_is_missing(
    tool: ModuleType,
    apt: Callable[[int], Commands],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    called = apt(0)
    monkeypatch.setattr(tool, "NEEDS", (a_browser(tool, False, True),))
    assert tool.main() == 0
    assert called == COMMANDS
    assert capsys.readouterr().out == "Installing system packages for tests: chromium\n"


@pytest.mark.parametrize("root", [True, False])
def test_what_cannot_be_installed_is_named_in_one_line(
    tool: ModuleType,
    apt: Callable[[int], Commands],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    root: bool,
) -> None:
    called = apt(100)
    monkeypatch.setattr(tool, "may_install", lambda: root)
    assert tool.main() == 0
    assert called == (COMMANDS if root else [])
    last = capsys.readouterr().out.splitlines()[-1]
    assert "a browser" in last
    assert "sudo apt-get install --no-install-recommends chromium" in last
    assert "Vulkan" not in last
    monkeypatch.setenv("CI", "1")
    assert tool.main() == 1


def test_nothing_is_done_where_nothing_is_missing(
    tool: ModuleType,
    apt: Callable[[int], Commands],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    called = apt(0)
    monkeypatch.setattr(tool, "NEEDS", tool.NEEDS[:1])
    assert tool.main() == 0
    assert (called, capsys.readouterr().out) == ([], "")
