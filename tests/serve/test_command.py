"""`pocketgs serve` as a command."""

from __future__ import annotations

import json
import os
import re
import signal
import ssl
import subprocess
import sys
from pathlib import Path

import pytest

from pocketgs.cli import main
from viewer.client import fetch

# A shell starts jobs in the background with Ctrl-C ignored.
PROGRAM = (
    "import signal; from pocketgs.cli import main; signal.signal(signal.SIGINT, signal.default_int_handler); main()"
)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_serve_until_ctrl_c(tmp_path: Path) -> None:
    """Over https and below a secret, to the network unless told otherwise."""
    command = [sys.executable, "-c", PROGRAM, "serve", str(tmp_path / "shelf"), "--no-open", "--max-upload", "7"]
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout
        found = re.fullmatch(r"page at (https://127\.0\.0\.1:(\d+)/([\w-]{22})/)\n", process.stdout.readline())
        assert found, process.communicate()
        trust = ssl.create_default_context(cafile=tmp_path / "cache" / "pocketgs" / "viewer.pem")
        shelf = fetch(found[1], "shelf.json", trust=trust).json
        assert (shelf["captures"], shelf["bounds"]["bytes"]) == ([], 7_000_000)
        assert shelf["efforts"] == ["quick", "standard", "best"]
        assert fetch(found[1], f"/{'x' * 22}/shelf.json", trust=trust).status == 403
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
    assert "stopping: a run that goes on keeps what it has trained" in printed
    kept = json.loads((tmp_path / "shelf" / ".pocketgs" / "address.json").read_text())
    assert kept == {"token": found[3], "port": int(found[2])}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--max-upload", "0"], "max upload: found 0, expected at least 1 MB"),
        (["--port", "70000", "--no-host"], "port 70000: found 70000"),
        (["--iterations", "0"], "iterations: found 0"),
        (["--downscale", "0.5"], "downscale 0.5, expected a factor of at least 1"),
        (["--hold-out", "1"], "held out every 1 frames, expected at least 2, or 0 for none"),
        (["--engine", "cpu", "--gpu", "voodoo"], "gpu 'voodoo': not used by engine cpu"),
    ],
)
def test_options(tmp_path: Path, arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["serve", str(tmp_path / "shelf"), "--no-open", *arguments])
    assert stop.value.code == 2
    assert sentence in capsys.readouterr().err


def test_a_folder_that_is_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "shelf").write_text("")
    with pytest.raises(SystemExit):
        main(["serve", str(tmp_path / "shelf"), "--no-open", "--no-host"])
    assert "captures: cannot be made" in capsys.readouterr().err
