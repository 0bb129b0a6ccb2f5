"""`pocketgs view` and `--view`: processes that serve a page until Ctrl-C, and their errors."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from pocketgs import Capture, Gaussians
from pocketgs.cli import main
from pocketgs.results.cameras_file import write_cameras
from pocketgs.scene.formats import read_scene, write_scene
from pocketgs.sort_free.file import read_sort_free, write_sort_free
from pocketgs.sort_free.scene import sort_free
from pocketgs.viewer.readable import readable_file
from viewer.client import fetch, following

# A shell starts jobs in the background with Ctrl-C ignored.
PROGRAM = (
    "import signal; from pocketgs.cli import main; signal.signal(signal.SIGINT, signal.default_int_handler); main()"
)
OPTIONS = ["--prior", "none", "--engine", "cpu", "--threads", "1"]


@pytest.fixture
def started() -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """A function that starts `pocketgs` and returns the process and its page's address; all end with the test."""
    processes: list[subprocess.Popen[str]] = []

    def start(*arguments: object) -> tuple[subprocess.Popen[str], str]:
        command = [sys.executable, "-c", PROGRAM, *map(str, arguments), "--no-open"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        processes.append(process)
        assert process.stdout
        address = re.fullmatch(r"page at (https?://127\.0\.0\.1:\d+/[\w-]+/)\n", process.stdout.readline())
        assert address, process.communicate()
        return process, address[1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., None]:
    """A function that runs `pocketgs view` in this process, which starts sooner than another one. In place of waiting
    for Ctrl-C, it calls a function with the page's address.
    """

    def run(look: Callable[[str], None], *arguments: object) -> None:
        looked: list[str] = []

        def look_once() -> None:
            looked.extend(re.findall(r"^page at (\S+)$", capsys.readouterr().out, re.MULTILINE))
            look(*looked)

        monkeypatch.setattr("pocketgs.cli.commands.view.wait_for_ctrl_c", look_once)
        main(["view", *map(str, arguments), "--no-open"])
        assert len(looked) == 1

    return run


@pytest.fixture
def scene() -> Gaussians:
    rng = np.random.default_rng(5)
    return Gaussians(*(rng.normal(size=(300, *tail)) for tail in ((3,), (3,), (4,), (), (4, 3))))


@pytest.fixture
def result(scene: Gaussians, small_capture: Capture, tmp_path: Path) -> Path:
    """The result folder of a run with refined poses."""
    folder = tmp_path / "toys-result"
    (folder / "held_out").mkdir(parents=True)
    scene.save(folder / "scene.ply")
    Image.new("RGB", (192, 72)).save(folder / "held_out" / "0000.png")
    write_cameras(folder / "cameras.json", small_capture.frames, refined=True)
    images = [{"name": frame.name} for frame in small_capture.held_out]
    (folder / "run.json").write_text(json.dumps({"capture": {"background": [1, 1, 1]}, "images": images}))
    return folder


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one-line error message of a command."""
    with pytest.raises(SystemExit) as stop:
        main(list(map(str, arguments)))
    errors = capsys.readouterr().err
    assert stop.value.code == 2
    assert errors.startswith("pocketgs: ")
    assert errors.count("\n") == 1
    return errors


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_view_until_ctrl_c(started: Callable[..., tuple[subprocess.Popen[str], str]], result: Path) -> None:
    process, url = started("view", result)
    told = fetch(url, "viewer.json").json
    assert told["title"] == "toys-result"
    assert fetch(url, told["scene"]["url"]).body == (result / "scene.ply").read_bytes()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (0, "")
    with pytest.raises(ConnectionError):
        fetch(url)


def test_view_of_a_sort_free_scene(view: Callable[..., None], scene: Gaussians, tmp_path: Path) -> None:
    """A file that the page can read is served as it is; of another, a copy that has the weights."""

    def look(url: str) -> None:
        told = fetch(url, "viewer.json").json
        assert fetch(url, told["scene"]["url"]).body == (tmp_path / "free.pgs").read_bytes()

    write_sort_free(tmp_path / "free.pgs", sort_free(scene, "visibility", 2.0))
    view(look, tmp_path / "free.pgs")
    write_sort_free(tmp_path / "little.ply", sort_free(scene, "lc", 2.0))
    path, data = tmp_path / "big.ply", PlyData.read(str(tmp_path / "little.ply"))
    data.byte_order = ">"
    data.write(str(path))
    free = read_sort_free(path)
    with readable_file(path, partial(write_sort_free, scene=free)) as copy:
        assert copy != path
        assert read_sort_free(copy).visibility_sh.tobytes() == free.visibility_sh.tobytes()


def test_view_of_a_result(view: Callable[..., None], result: Path, small_capture: Capture) -> None:
    def look(url: str) -> None:
        told = fetch(url, "viewer.json").json
        assert told["background"] == [1, 1, 1]
        assert told["previews"] == ["previews/0000.png"]
        assert fetch(url, "previews/0000.png").body == (result / "held_out" / "0000.png").read_bytes()
        held_out = {camera["name"] for camera in told["cameras"] if camera["held_out"]}
        assert held_out == {frame.name for frame in small_capture.held_out}
        for camera in told["cameras"]:
            assert (camera["width"], camera["height"], camera["photo"]) == (96, 72, None)
        cameras = {frame.name: frame.camera for frame in small_capture.frames}
        for camera in told["cameras"]:
            truth = cameras[camera["name"]]
            assert np.array_equal(np.reshape(camera["world_to_camera"], (4, 4)), truth.world_to_camera)
            assert [camera[name] for name in ("fx", "fy", "cx", "cy")] == [truth.fx, truth.fy, truth.cx, truth.cy]

    view(look, result)


def test_view_with_the_capture(view: Callable[..., None], result: Path, written_capture: Path) -> None:
    def look(url: str) -> None:
        cameras = fetch(url, "viewer.json").json["cameras"]
        assert [camera["held_out"] for camera in cameras] == [True, False, False, False] * 2
        assert all(fetch(url, camera["photo"]).status == 200 for camera in cameras)

    (result / "cameras.json").unlink()
    view(look, result, "--capture", written_capture, "--hold-out", "4")


@pytest.mark.parametrize("name", ["toys.pgs", "toys.spz", "toys.splat", "toys.compressed.ply", "toys.glb"])
def test_view_of_any_format(view: Callable[..., None], scene: Gaussians, tmp_path: Path, name: str) -> None:
    def look(url: str) -> None:
        told = fetch(url, "viewer.json").json
        body = fetch(url, told["scene"]["url"]).body
        assert told["scene"]["bytes"] == len(body)
        assert told["scene"]["is_copy"] == (told["scene"]["url"] == "scene.ply")
        if name in ("toys.pgs", "toys.spz", "toys.splat"):
            assert told["scene"]["url"] == f"scene.{name.rpartition('.')[2]}"
            assert body == (tmp_path / name).read_bytes()
        else:  # as a plain .ply
            (tmp_path / "told.ply").write_bytes(body)
            assert told["scene"]["url"] == "scene.ply"
            assert len(Gaussians.load(tmp_path / "told.ply")) == 300
        assert told["cameras"] == []
        assert np.allclose(told["target"], np.median(read_scene(tmp_path / name).means, axis=0), atol=0.05)

    write_scene(tmp_path / name, scene)
    view(look, tmp_path / name)


@pytest.mark.parametrize("kind", ["toys.sog", "toys.compressed.ply", "big.ply"])
def test_a_copy_keeps_the_mark_of_anti_aliasing(
    view: Callable[..., None], scene: Gaussians, tmp_path: Path, kind: str
) -> None:
    def look(url: str) -> None:
        body = fetch(url, "scene.ply").body
        header = body.partition(b"end_header")[0].decode()
        assert ("comment SplatRenderMode: mip" in header.splitlines()) == is_marked

    path = tmp_path / kind
    for is_marked in (False, True):
        write_scene(path, scene)
        if kind == "toys.sog":
            mark_sog(path, is_marked)
        else:
            data = PlyData.read(str(path), mmap=False)
            data.byte_order = ">" if kind == "big.ply" else "<"
            data.comments = ["SplatRenderMode: mip"] if is_marked else []
            data.write(str(path))
        view(look, path)


def mark_sog(path: Path, is_marked: bool) -> None:
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    parts["meta.json"] = json.dumps(json.loads(parts["meta.json"]) | {"antialias": is_marked}).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"])
def test_copies_of_headers_that_the_page_does_not_read(scene: Gaussians, tmp_path: Path, line_end: bytes) -> None:
    """It reads lines that end in a line feed; and a comment may name the last line."""
    path = tmp_path / "toys.ply"
    scene.save(path)
    header, end, body = path.read_bytes().partition(b"end_header\n")
    header = header.replace(b"element", b"comment no end_header\nelement", 1)
    path.write_bytes((header + end).replace(b"\n", line_end) + body)
    assert read_scene(path).means.tobytes() == scene.means.tobytes()
    with readable_file(path, scene.save) as file:
        assert (file == path) == (line_end != b"\r")


def test_view_refuses(capsys: pytest.CaptureFixture[str], result: Path, tmp_path: Path) -> None:
    assert "none.ply: no such file" in refused(capsys, "view", tmp_path / "none.ply")
    assert "scene.ply: no such file" in refused(capsys, "view", tmp_path)
    assert "none: no such file or folder" in refused(capsys, "view", result, "--capture", tmp_path / "none")
    assert "port 70000: found 70000" in refused(capsys, "view", result, "--port", 70000)
    (result / "cameras.json").write_text('{"refined": true, "cameras": {"a": [1, 2]}}')
    assert "cameras.json: 'a' is not a camera" in refused(capsys, "view", result)
    (result / "cameras.json").write_text("[]")
    assert "cameras.json: not a readable file of cameras" in refused(capsys, "view", result)
    (result / "run.json").write_text("{")
    assert "run.json: not valid JSON" in refused(capsys, "view", result)
    (result / "scene.ply").write_bytes(b"ply\n")
    assert "scene.ply: not a" in refused(capsys, "view", result)


def test_port_in_use(
    view: Callable[..., None],
    capsys: pytest.CaptureFixture[str],
    result: Path,
    written_capture: Path,
    tmp_path: Path,
) -> None:
    def look(url: str) -> None:
        port = url.split(":")[2].split("/")[0]
        assert f"port {port}: in use" in refused(capsys, "view", result, "--port", port)
        command = ["train", written_capture, "--output", tmp_path / "out", "--view", "--port", port]
        assert f"port {port}: in use" in refused(capsys, *command)
        assert not (tmp_path / "out").exists()

    view(look, result)


@pytest.mark.parametrize("option", [["--host"], ["--port", "8000"], ["--no-open"], ["--no-wait"]])
def test_options_without_a_page(
    capsys: pytest.CaptureFixture[str], written_capture: Path, tmp_path: Path, option: list[str]
) -> None:
    assert "expected --view" in refused(capsys, "train", written_capture, "--output", tmp_path / "out", *option)
    assert "expected --view" in refused(capsys, "demo", "--output", tmp_path / "out", *option)


def test_view_over_the_network(
    started: Callable[..., tuple[subprocess.Popen[str], str]],
    result: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    process, url = started("view", result, "--host")
    assert url.startswith("https://")
    assert process.stdout
    lines = [process.stdout.readline()]
    while not lines[-1].startswith("Ctrl-C"):
        lines.append(process.stdout.readline())
    text = "".join(lines)
    assert "The browser will warn that the certificate" in text
    assert re.search(r"([0-9A-F]{2}:){31}[0-9A-F]{2} \(SHA-256\)", text)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_training_stopped_from_its_page(
    started: Callable[..., tuple[subprocess.Popen[str], str]], written_capture: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    process, url = started("train", written_capture, "--output", output, *OPTIONS, "--iterations", 10**6, "--view")

    async def watch_and_stop() -> int:
        async with following(url) as page:
            while not page.scenes:
                assert await page.read()
            await page.say("stop")
            return (await page.until(finished=True))["iteration"]

    iterations = asyncio.run(asyncio.wait_for(watch_and_stop(), 60))
    record = json.loads((output / "run.json").read_text())
    assert (record["iterations"], record["interrupted"]) == (iterations, True)
    # The page stays.
    told = fetch(url, "viewer.json").json
    assert (told["live"], told["previews"]) == (True, ["previews/images_0000.png"])
    assert fetch(url, told["cameras"][0]["photo"]).status == 200
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (0, "")
    assert "(stopped early)" in printed
    assert f"the page stays at {url} until Ctrl-C" in printed


def test_page_that_ends_with_its_run(
    started: Callable[..., tuple[subprocess.Popen[str], str]], written_capture: Path, tmp_path: Path
) -> None:
    command = ["train", written_capture, "--output", tmp_path / "out", *OPTIONS, "--iterations", 20]
    process, url = started(*command, "--view", "--no-wait")
    printed, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
    assert "20 iterations" in printed
    with pytest.raises(ConnectionError):
        fetch(url)
