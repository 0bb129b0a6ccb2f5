"""Captures with anything broken in them are read, or refused by a sentence: nothing else, and nothing hangs."""

from __future__ import annotations

import base64
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from PIL import Image

from attack.mutations import broken_bytes, mutated
from capture.phone_layouts import WRITERS, in_order, zip_folder
from conftest import write_nerfstudio
from pocketgs.capture import Capture
from static_site.videos import write_h264
from zip_files import zip_of

Call = Callable[..., Any]

OUTCOMES = """
    const {FileTree, StoredFile} = await import(new URL("archive/tree.js", location.href));
    const {filesInZip} = await import(new URL("archive/zip.js", location.href));
    const {outlineOf} = await import(new URL("capture/outline.js", location.href));
    const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const whole = Object.entries(given.files ?? {}).map(([path, text]) => [path, bytesOf(text)]);
    const readAll = async ({path, content, archive}) => {
        const replaced = whole.map(([name, bytes]) => [name, name === path ? bytesOf(content) : bytes]);
        const files = archive
            ? await filesInZip(new Blob([bytesOf(archive)]), "capture.zip")
            : replaced.map(([name, bytes]) => new StoredFile(name, bytes.length, async () => bytes));
        const listing = await module.readListing(new FileTree(files), settings.capture);
        await outlineOf(listing, settings.capture);
        const {train} = await module.loadCapture(listing, 12, settings, () => {});
        return train.every(({rgba, camera}) => rgba.length === 4 * camera.width * camera.height) ? "read" : "uneven";
    };
    const outcomeOf = (broken) => Promise.race([
        readAll(broken).catch((error) => [error.name, error.message]),
        new Promise((resolve) => setTimeout(() => resolve("hangs"), 10_000)),
    ]);
    const outcomes = [];
    for (const broken of [{}, ...given.broken]) {
        outcomes.push(await outcomeOf(broken));
    }
    return outcomes;
"""

ROUNDS = 40


@pytest.fixture(scope="module")
def three_views(small_capture: Capture) -> Capture:
    frames = in_order(small_capture)
    return replace(small_capture, train=frames[1:3], held_out=frames[:1])


def write(name: str, capture: Capture, folder: Path) -> None:
    if name == "with masks":
        write_nerfstudio(capture, folder)
        for path in (folder / "images").iterdir():
            mask = Image.fromarray(np.full((72, 96), 255, np.uint8))
            (folder / "masks").mkdir(exist_ok=True)
            mask.save(folder / "masks" / path.name)
    else:
        WRITERS[name](capture, folder)
    if name == "stray-scanner":
        write_h264(folder / "rgb.mp4", [frame.image for frame in in_order(capture)])


def text_of(content: bytes) -> str:
    return base64.b64encode(content).decode()


def assert_sentences(outcomes: list[Any]) -> None:
    whole, *broken = outcomes
    assert whole == "read"
    for outcome in broken:
        if outcome != "read":
            name, message = outcome
            assert (name, len(message) > 10, len(message) < 600) == ("Error", True, True), outcome
    refused = sum(outcome != "read" for outcome in broken)
    assert 0 < refused < len(broken)


@pytest.mark.parametrize("name", [*WRITERS, "with masks"])
def test_a_broken_file_in_any_layout(call: Call, three_views: Capture, tmp_path: Path, name: str) -> None:
    write(name, three_views, tmp_path / "capture")
    files = {
        path.relative_to(tmp_path / "capture").as_posix(): path.read_bytes()
        for path in sorted((tmp_path / "capture").rglob("*"))
        if path.is_file() and "depth" not in path.as_posix() and "conf" not in path.as_posix()
    }
    rng = Random(name)
    texts = [path for path, content in files.items() if len(content) > 2 and not path.endswith((".jpg", ".png"))]
    places = [rng.choice(texts if rng.random() < 0.75 else list(files)) for _ in range(ROUNDS)]
    broken = [{"path": path, "content": text_of(mutated(rng, Path(path).name, files[path]))} for path in places]
    given = {"files": {path: text_of(content) for path, content in files.items()}, "broken": broken}
    assert_sentences(call("capture/open.js", OUTCOMES, given))


@pytest.mark.parametrize("name", ["polycam", "stray-scanner"])
def test_broken_archives(call: Call, three_views: Capture, tmp_path: Path, name: str) -> None:
    write(name, three_views, tmp_path / "capture")
    whole = zip_folder(tmp_path / "capture", tmp_path / "capture.zip").read_bytes()
    directory = whole.rindex(b"PK\x05\x06") - 2000
    rng = Random(name)
    broken = [
        whole[:directory] + broken_bytes(rng, whole[directory:]) if rng.random() < 0.7 else broken_bytes(rng, whole)
        for _ in range(ROUNDS)
    ]
    tables = {"odometry.csv": b"frame\n" * 100, "camera_matrix.csv": bytes(100_000)}
    broken.append(zip_of({**tables, "rgb.mp4": b"\0\0\0\0moov" * 1000}, zipfile.ZIP_STORED))
    files = {
        path.relative_to(tmp_path / "capture").as_posix(): text_of(path.read_bytes())
        for path in (tmp_path / "capture").rglob("*")
        if path.is_file()
    }
    given = {"files": files, "broken": [{"archive": text_of(content)} for content in broken]}
    assert_sentences(call("capture/open.js", OUTCOMES, given))
