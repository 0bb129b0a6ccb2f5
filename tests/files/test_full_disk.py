"""A full disk at any point of a write is an error, and keeps the earlier file."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pocketgs import Capture, Gaussians
from pocketgs.benchmark.report import write_report
from pocketgs.capture.colmap_export import export_capture
from pocketgs.errors import PocketGSError
from pocketgs.results.cameras_file import write_cameras
from pocketgs.results.checkpoint import write_checkpoint
from pocketgs.results.folder import publishing, write_json, write_side_by_side
from pocketgs.results.video import write_video
from pocketgs.splat.engine import OptimiserState
from pocketgs.training.result import Checkpoint

resource = pytest.importorskip("resource")

SCENES = ["a.ply", "a.compressed.ply", "a.spz", "a.splat", "a.glb"]


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """A limit on file sizes, which makes writes fail like a full disk."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def fails_at_any_length(path: Path, write: Callable[[], Any], tries: int = 12) -> None:
    """Check that truncation anywhere is an error, and that the earlier content is kept.

    Right before the end is the hardest: those bytes wait in buffers until the file is closed.
    """
    write()
    before = path.read_bytes()
    lengths = {len(before) - 1, len(before) - 100, *np.linspace(0, len(before) - 1, tries).astype(int).tolist()}
    for length in sorted(length for length in lengths if 0 <= length < len(before)):
        with files_of_at_most(length), pytest.raises(PocketGSError):
            write()
        assert path.read_bytes() == before
        assert [each for each in path.parent.iterdir() if each.name.endswith(("partial", path.suffix))] == [path]


def scene(count: int) -> Gaussians:
    rng = np.random.default_rng(0)
    return Gaussians(*(rng.normal(size=(count, *tail)) for tail in [(3,), (3,), (4,), (), (4, 3)]))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("count", [3, 700])
def test_scenes(tmp_path: Path, name: str, count: int) -> None:
    written = scene(count)
    fails_at_any_length(tmp_path / name, lambda: written.save(tmp_path / name))


def test_videos(tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """With a codec that always gives the same bytes: on a busy machine libx264 codes a frame in a hundred otherwise."""
    monkeypatch.setattr("pocketgs.results.video.CODEC", "mpeg4")
    monkeypatch.setattr("pocketgs.results.video.QUALITY", {})
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 255, (48, 64, 3), dtype=np.uint8) for _ in range(30)]
    fails_at_any_length(tmp_path / "a.mp4", lambda: write_video(tmp_path / "a.mp4", frames), tries=40)
    assert capfd.readouterr().err == ""  # nor do the libraries below talk to the user


def test_what_a_run_writes(tmp_path: Path, small_capture: Capture) -> None:
    moments = np.zeros((50, 22), np.float32)
    checkpoint = Checkpoint(3, scene(50), OptimiserState(moments, moments, 3))
    fails_at_any_length(tmp_path / "a.npz", lambda: write_checkpoint(tmp_path / "a.npz", checkpoint, {"seed": 1}))
    (tmp_path / "a").mkdir()
    path = tmp_path / "a" / "run.json"
    fails_at_any_length(path, lambda: write_json(path, {"a": [1.5] * 3000}))
    path = tmp_path / "cameras.json"
    fails_at_any_length(path, lambda: write_cameras(path, small_capture.frames, True))


def test_pictures(tmp_path: Path, small_capture: Capture) -> None:
    photo = small_capture.train[0].image

    def write() -> None:
        with publishing(tmp_path / "result") as staging:
            write_side_by_side(staging, "a", photo, photo / np.float32(255))

    fails_at_any_length(tmp_path / "result" / "a.png", write)


def test_exported_captures(tmp_path: Path, small_capture: Capture) -> None:
    export_capture(tmp_path / "whole", small_capture)
    sizes = [path.stat().st_size for path in (tmp_path / "whole").rglob("*") if path.is_file()]
    for size in (100, min(sizes) - 1, max(sizes) - 1):
        with files_of_at_most(size), pytest.raises(PocketGSError):
            export_capture(tmp_path / "new", small_capture)
        assert [path.name for path in tmp_path.iterdir()] == ["whole"]


def test_reports(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    path = tmp_path / "report.html"
    fails_at_any_length(path, lambda: write_report([], None, path), tries=4)
