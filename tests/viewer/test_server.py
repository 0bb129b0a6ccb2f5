"""The server's responses, access control, and errors."""

from __future__ import annotations

import asyncio
import io
import json
import os
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from aiohttp import ClientSession, WSServerHandshakeError
from PIL import Image

import pocketgs.viewer.routes
from pocketgs import Capture, Gaussians, PocketGSError
from pocketgs.results.folder import write_transients
from pocketgs.splat.webgpu.passes import describe_rendering
from pocketgs.splat.webgpu.variant import Variant
from pocketgs.viewer.access import Access, is_same_origin
from pocketgs.viewer.content import Content, capture_views, looked_at
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.responses import send_json
from pocketgs.viewer.scene_content import previews_in, scene_content, with_transients
from pocketgs.viewer.server import Page, serving
from viewer.client import fetch, origin_of

PATHS = ["", "page/main.js", "gpu/executor.js", "passes.json", "viewer.json", "scene.ply", "photos/0.jpg", "live", "x"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, a preview, a secret beside them, and a link to that."""
    folder = tmp_path_factory.mktemp("served")
    rng = np.random.default_rng(3)
    scene = Gaussians(*(rng.normal(size=(5000, *tail)) for tail in ((3,), (3,), (4,), (), (4, 3))))
    scene.save(folder / "toys.ply")
    (folder / "toys.ply.gz").write_bytes(b"what a server that likes packed files would send instead")
    (folder / "secret.png").write_bytes(b"secret")
    (folder / "held_out").mkdir()
    Image.new("RGB", (8, 4)).save(folder / "held_out" / "a b#1.png")
    return folder


@pytest.fixture(scope="module")
def content(folder: Path, small_capture: Capture) -> Content:
    views = capture_views(small_capture)
    up, target = looked_at(views)
    previews = {path.name: path for path in (folder / "held_out").iterdir()}
    return Content("toys", folder / "toys.ply", views=views, up=up, target=target, previews=previews)


@pytest.fixture(scope="module")
def page(content: Content) -> Iterator[Page]:
    with serving(content) as page:
        yield page


@pytest.mark.parametrize("broken", [1, 3])
def test_gaussians_that_are_not_finite_leave_a_page(tmp_path: Path, broken: int) -> None:
    """It turns about the middle of the others; NaN would be no JSON."""
    scene = Gaussians(*(np.zeros((3, *tail)) for tail in ((3,), (3,), (4,), (), (1, 3))))
    scene.means[:] = [1, 2, 3]
    scene.means[:broken, 1] = np.nan
    scene.save(tmp_path / "toys.ply")
    with serving(scene_content("toys", tmp_path / "toys.ply", scene, None, None)) as page:
        told = fetch(page.url, "viewer.json").json
    assert told["target"] == ([1, 2, 3] if broken == 1 else [0, 0, 0])
    with pytest.raises(ValueError, match="JSON"):
        send_json({"target": [np.nan]})


def test_what_the_page_is_told(page: Page, content: Content, small_capture: Capture) -> None:
    told = fetch(page.url, "viewer.json").json
    size = content.scene.stat().st_size if content.scene else 0
    assert told["title"] == "toys"
    assert told["scene"] == {"url": "scene.ply", "bytes": size, "is_copy": False}
    assert told["live"] is False
    assert told["background"] == [0, 0, 0]
    assert told["previews"] == ["previews/a%20b%231.png"]
    assert [camera["name"] for camera in told["cameras"]] == sorted(frame.name for frame in small_capture.frames)
    assert sum(camera["held_out"] for camera in told["cameras"]) == len(small_capture.held_out) == 1
    frames = {frame.name: frame for frame in small_capture.frames}
    for camera in told["cameras"]:
        true = frames[camera["name"]].camera
        assert np.array_equal(np.reshape(camera["world_to_camera"], (4, 4)), true.world_to_camera)
        assert [camera[name] for name in ("width", "height", "fx", "cy")] == [true.width, true.height, true.fx, true.cy]
        pixels, depth = true.project(np.array([told["target"]]))
        assert depth[0] > 0
        assert np.all(np.abs(pixels[0] - [true.cx, true.cy]) < true.width)
    assert np.linalg.norm(told["up"]) == pytest.approx(1)


def test_photographs(page: Page, small_capture: Capture) -> None:
    told = fetch(page.url, "viewer.json").json
    frames = {frame.name: frame for frame in small_capture.frames}
    for camera in told["cameras"][:2]:
        answer = fetch(page.url, camera["photo"])
        assert answer.headers["Content-Type"] == "image/jpeg"
        photo = np.asarray(Image.open(io.BytesIO(answer.body)))
        assert np.abs(photo.astype(float) - frames[camera["name"]].image).mean() < 5
    for number in ("8", "999999", "1000000", "-1", "x"):
        assert fetch(page.url, f"photos/{number}.jpg").status == 404


def test_scene_comes_as_it_is(page: Page, folder: Path) -> None:
    answer = fetch(page.url, "scene.ply", headers={"Accept-Encoding": "gzip, br", "Range": "bytes=5-9"})
    assert answer.status == 200
    assert answer.body == (folder / "toys.ply").read_bytes()
    assert answer.headers["Content-Length"] == str(len(answer.body))
    assert "Content-Encoding" not in answer.headers


def test_modules_and_passes(page: Page, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<!doctype html>")
    (tmp_path / "main.js").write_text("export {};")
    (tmp_path / "drawing").mkdir()
    (tmp_path / "drawing" / "renderer.js").write_text("export {};")
    monkeypatch.setattr(pocketgs.viewer.routes, "PAGE", tmp_path)
    for path, kind in {
        "": "text/html",
        "page/main.js": "text/javascript",
        "page/drawing/renderer.js": "text/javascript",
        "page/constants.js": "text/javascript",
        "gpu/executor.js": "text/javascript",
    }.items():
        answer = fetch(page.url, path)
        assert answer.status == 200, path
        assert answer.headers["Content-Type"] == f"{kind}; charset=utf-8"
    for appearance in ("splats", "points", "discs"):
        expected = describe_rendering(Variant(appearance=appearance)).to_json()
        assert fetch(page.url, f"passes.json?appearance={appearance}").json == json.loads(json.dumps(expected))
    expected = describe_rendering(Variant(weights="lc")).to_json()
    assert fetch(page.url, "passes.json?weights=lc").json == json.loads(json.dumps(expected))
    assert fetch(page.url, "passes.json?weights=magic").status == 404
    assert fetch(page.url, "passes.json").json == fetch(page.url, "passes.json?appearance=splats").json
    for path in (
        "passes.json?appearance=cubes",
        "page/main.ts",
        "page/drawing",
        "gpu/sort.py",
        "gpu/shaders",
        "live",
        "progress.json",
    ):
        assert fetch(page.url, path).status == 404, path


def test_page_that_is_shipped(page: Page) -> None:
    assert b"<html" in fetch(page.url).body


@pytest.mark.parametrize("path", PATHS)
def test_without_the_token(page: Page, path: str) -> None:
    right = urlsplit(page.url).path
    for token in ("/", "/wrong/", right.swapcase(), right[:-2] + "/", f"/{right}", "/%00/", "/%ff%fe/"):
        at = token + path
        answer = fetch(page.url, at)
        assert (answer.status, answer.body) == (403, b"Forbidden"), at
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
    handshake = {"Upgrade": "websocket", "Connection": "Upgrade", "Origin": origin_of(page.url)}
    assert fetch(page.url, f"/wrong/{path}", headers=handshake).status == 403


@pytest.mark.parametrize("climb", ["..", "%2e%2e", "%2E.", "..%2f..", "..%5c", "..\\", "%252e%252e", "/etc", "%2fetc"])
@pytest.mark.parametrize("start", ["", "page/", "page/drawing/", "gpu/", "previews/"])
def test_paths_that_climb(page: Page, folder: Path, start: str, climb: str) -> None:
    for name in ("secret.png", "toys.ply", "passwd", "engine.py", "server.py"):
        path = f"{start}{climb}/{name}" if not climb.startswith("/") else f"{start}{folder}/{name}"
        if not path.startswith("/"):
            answer = fetch(page.url, path)
            assert answer.status in (403, 404), path
            assert b"secret" not in answer.body


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links here")
def test_links_that_lead_out_are_not_previews(folder: Path, tmp_path: Path) -> None:
    inside = tmp_path / "result" / "held_out"
    inside.mkdir(parents=True)
    (inside / "a.png").write_bytes((folder / "secret.png").read_bytes())
    try:
        (inside / "out.png").symlink_to(folder / "secret.png")
        (inside / "in.png").symlink_to(inside / "a.png")
    except OSError as error:
        pytest.skip(f"no links here: {error}")
    with serving(Content("x", previews=previews_in(inside.parent))) as page:
        assert fetch(page.url, "viewer.json").json["previews"] == ["previews/a.png", "previews/in.png"]
        assert fetch(page.url, "previews/a.png").body == b"secret"
        assert fetch(page.url, "previews/out.png").status == 404
        # Swapped while the page is open.
        (inside / "a.png").unlink()
        (inside / "a.png").symlink_to(folder / "secret.png")
        assert fetch(page.url, "previews/a.png").status == 404
    elsewhere = tmp_path / "other"
    elsewhere.mkdir()
    (elsewhere / "held_out").symlink_to(inside, target_is_directory=True)
    assert previews_in(elsewhere) == {}


def test_pictures_of_what_moved(small_capture: Capture, tmp_path: Path) -> None:
    cells = [np.full((6, 8), number == 1) for number in range(len(small_capture.train))]
    write_transients(tmp_path, small_capture.train, cells)
    views = with_transients(capture_views(small_capture), tmp_path)
    written = next((tmp_path / "transients").iterdir()).read_bytes()
    with serving(Content("x", views=views)) as page:
        cameras = fetch(page.url, "viewer.json").json["cameras"]
        moved = [camera for camera in cameras if camera["transients"]]
        assert [camera["name"] for camera in moved] == [small_capture.train[1].name]
        assert fetch(page.url, moved[0]["transients"]).body == written
        still = cameras.index(next(camera for camera in cameras if not camera["transients"]))
        assert fetch(page.url, f"transients/{still}.png").status == 404
        assert fetch(page.url, f"transients/{len(cameras)}.png").status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "TRACE"])
def test_only_get(page: Page, method: str) -> None:
    for path in ("", "viewer.json", "live", "x"):
        assert fetch(page.url, path, method=method).status == 405
        assert fetch(page.url, f"/wrong/{path}", method=method).status == 403
    with serving(LiveRun("toys")) as live:
        for path in ("", "viewer.json", "news.json", "x", *(["live"] if method != "POST" else [])):
            assert fetch(live.url, path, method=method, headers={"Origin": origin_of(live.url)}).status == 405


def test_bodies_are_not_read(page: Page) -> None:
    assert fetch(page.url, "viewer.json", body=b"hello").status == 413
    assert fetch(page.url, "viewer.json", method="POST", body=b"hello").status == 405
    # One that would never end is cut off.
    parts = urlsplit(page.url)
    with socket.create_connection((str(parts.hostname), parts.port), timeout=20) as client:
        head = f"POST {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\nContent-Length: 1000000000\r\n\r\n"
        client.sendall(head.encode())
        received, sent = b"", 0
        with suppress(OSError):
            while sent < 10**9:
                client.sendall(bytes(1 << 20))
                sent += 1 << 20
        client.settimeout(20)
        with suppress(OSError):  # what it has answered may be lost when it hangs up
            received = client.recv(4096)
    assert not received or received.startswith(b"HTTP/1.1 405")
    assert sent < 10**8


def test_what_is_no_http(page: Page, capfd: pytest.CaptureFixture[str]) -> None:
    parts = urlsplit(page.url)
    for nonsense in (b"\x16\x03\x01\x02\x00\x01", b"GET\r\n\r\n", b"GET / HTTP/1.1\r\nA" + b"a" * 10**5 + b"\r\n\r\n"):
        with socket.create_connection((str(parts.hostname), parts.port), timeout=20) as client:
            client.sendall(nonsense)
            client.shutdown(socket.SHUT_WR)
            assert b"secret" not in client.recv(4096)
    assert fetch(page.url, "viewer.json").status == 200
    assert capfd.readouterr().err == ""


def test_strangers_names(page: Page) -> None:
    port = urlsplit(page.url).port
    for host in ("localhost", f"localhost:{port}", f"127.0.0.1:{port}", f"LOCALHOST:{port}", "127.0.0.1:1"):
        assert fetch(page.url, "viewer.json", headers={"Host": host}).status == 200, host
    for host in (
        "evil.example",
        f"evil.example:{port}",
        "",
        "127.0.0.1.evil.example",
        "[::1",
        f"10.0.0.1:{port}",
        "a@b",
    ):
        assert fetch(page.url, "viewer.json", headers={"Host": host}).status == 403, host


def test_headers(page: Page) -> None:
    for path in ("viewer.json", "scene.ply", "gpu/executor.js", "x"):
        headers = fetch(page.url, path).headers
        assert headers["Cache-Control"] == "no-store"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        policy = dict(rule.split(" ", 1) for rule in headers["Content-Security-Policy"].split("; "))
        assert policy["default-src"] == policy["base-uri"] == policy["frame-ancestors"] == "'none'"
        assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
        assert "aiohttp" not in headers["Server"]


def test_origins_on_the_websocket() -> None:
    async def open_socket(url: str, origin: str | None) -> int:
        async with ClientSession() as session:
            try:
                async with session.ws_connect(url, origin=origin):
                    return 101
            except WSServerHandshakeError as error:
                return error.status

    with serving(LiveRun("toys")) as page:
        here = origin_of(page.url)
        strangers = [
            "https://evil.example",
            here.replace("http:", "https:"),
            here + "0",
            "http://localhost",
            "null",
            None,
        ]
        for origin in strangers:
            assert asyncio.run(open_socket(f"{page.url}live", origin)) == 403, origin
        assert asyncio.run(open_socket(f"{page.url[:-3]}/live", here)) == 403
        assert asyncio.run(open_socket(f"{page.url}live", here)) == 101
        assert fetch(page.url, "live", headers={"Origin": here}).status == 400


def test_commands_by_request() -> None:
    """From the page itself only, and short ones only."""
    run = LiveRun("toys")
    with serving(run) as page:
        here, pause = origin_of(page.url), b'{"type": "pause"}'

        def post(path: str, body: bytes, **headers: str) -> int:
            return fetch(page.url, path, method="POST", body=body, headers=headers).status

        for origin in ("https://evil.example", here + "0", "null"):
            assert post("live", pause, Origin=origin) == 403
        assert post("live", pause) == 403
        assert post("live", pause, Origin="http://evil.example", Host="evil.example") == 403
        for path in ("/live", "/wrong/live", f"{urlsplit(page.url).path[:-2]}/live"):
            assert post(path, pause, Origin=here) == 403, path
        for body in (b"", b"hello", b"[]", b'{"type": "restart"}', b"\xff", b"[" * 200):
            assert post("live", body, Origin=here) == 400, body
        assert post("live", pause, **{"Origin": here, "Content-Encoding": "gzip"}) == 400
        assert post("live", pause + b" " * 300, Origin=here) == 413
        assert not run.news.progress["paused"]
        assert post("live", pause, Origin=here) == 204
        assert run.news.progress["paused"]
        assert post("live", b'{"type": "resume"}', Origin=here) == 204
        assert not run.news.progress["paused"]


def test_command_that_never_ends() -> None:
    """It is cut off, although its size is not stated."""
    with serving(LiveRun("toys")) as page:
        parts = urlsplit(page.url)
        with socket.create_connection((str(parts.hostname), parts.port), timeout=20) as client:
            head = f"POST {parts.path}live HTTP/1.1\r\nHost: {parts.netloc}\r\nOrigin: {origin_of(page.url)}\r\n"
            client.sendall(f"{head}Transfer-Encoding: chunked\r\n\r\n".encode())
            sent = 0
            with suppress(OSError):
                while sent < 10**9:
                    client.sendall(b"10000\r\n" + bytes(0x10000) + b"\r\n")
                    sent += 0x10000
        assert sent < 10**8


def test_scene_that_is_gone(content: Content, tmp_path: Path) -> None:
    with serving(replace(content, scene=tmp_path / "gone.ply")) as page:
        assert fetch(page.url, "viewer.json").status == 404
        assert fetch(page.url, "scene.ply").status == 404


def test_server_ends_with_its_block(content: Content) -> None:
    with serving(content) as page:
        assert fetch(page.url, "viewer.json").status == 200
        port = urlsplit(page.url).port
        assert port
        with (
            pytest.raises(PocketGSError, match=rf"port {port}: in use, expected a free one"),
            serving(content, port=port),
        ):
            pass
    with serving(content, port=port) as again:
        assert urlsplit(again.url).port == port
        assert again.url != page.url
    with pytest.raises(ConnectionError):
        fetch(again.url, "viewer.json")


def test_block_that_fails_ends_the_server_too(content: Content) -> None:
    with pytest.raises(KeyError), serving(content) as page:
        raise KeyError
    with pytest.raises(ConnectionError):
        fetch(page.url)


@pytest.mark.parametrize("port", [-1, 65536])
def test_what_is_no_port(content: Content, port: int) -> None:
    with (
        pytest.raises(PocketGSError, match=f"port {port}: found {port}, expected 0 to 65535"),
        serving(content, port=port),
    ):
        pass


def test_only_this_machine_is_served(page: Page) -> None:
    assert urlsplit(page.url).hostname == "127.0.0.1"
    assert (page.network_url, page.fingerprint) == (None, None)


def test_an_address_that_this_machine_gets_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as in another network. Names stay as they were: foreign pages can point theirs at any address."""
    monkeypatch.setattr("pocketgs.viewer.access.lan_addresses", lambda: ["192.168.7.8"])
    inside, outside = Access(frozenset({"localhost"}), network=True), Access(frozenset({"localhost"}))
    assert inside.serves_host("192.168.7.8:8000")
    assert not outside.serves_host("192.168.7.8:8000")
    assert not inside.serves_host("192.168.7.9:8000")
    assert not inside.serves_host("evil.example:8000")


def test_tokens_differ_and_stay_out_of_reports() -> None:
    one, other = Access(frozenset()), Access(frozenset())
    assert one.token != other.token
    assert len(one.token) >= 22
    assert one.token not in repr(one)


def test_same_origin_is_exact() -> None:
    assert is_same_origin("http://LOCALHOST:8000", "http", "localhost:8000")
    assert not is_same_origin("http://localhost:8000/", "http", "localhost:8000")
    assert not is_same_origin("", "http", "")
