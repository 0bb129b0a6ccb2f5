"""Scenes that were trained with anti-aliasing: every format's mark is a warning."""

from __future__ import annotations

import json
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from pocketgs.scene.formats import read_scene, write_scene
from pocketgs.scene.formats.antialiased import is_marked
from pocketgs.scene.warning import SceneWarning
from scene.formats.scenes import random_scene


@pytest.mark.parametrize(
    ("comments", "expected"),
    [
        ([], False),
        (["SplatRenderMode: mip"], True),
        (["Exported from Brush", "SplatRenderMode: default"], False),
        (["antialiased 1"], True),
        (["antialiased 0"], False),
        (["SPLATRENDERMODE:  MIP "], True),
        (["antialiased 1", "SplatRenderMode: default"], False),
        (["SplatRenderMode: 2dgs", "antialiased 1"], True),
        (["mip", "1", "antialiased"], False),
    ],
)
def test_comments(comments: list[str], expected: bool) -> None:
    assert is_marked(comments) == expected


def with_comment(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"element", b"comment SplatRenderMode: mip\nelement", 1))


def with_flag(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[14] |= 1
    path.write_bytes(content)


def with_entry(key: str, value: object) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            parts = {name: archive.read(name) for name in archive.namelist()}
        parts["meta.json"] = json.dumps(json.loads(parts["meta.json"]) | {key: value}).encode()
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in parts.items():
                archive.writestr(name, content)

    return change


@pytest.mark.parametrize(
    ("suffix", "mark"),
    [
        (".ply", with_comment),
        (".compressed.ply", with_comment),
        (".spz", with_flag),
        (".sog", with_entry("model", "antialiased")),
        (".sog", with_entry("antialias", True)),
    ],
)
def test_marked_files_are_read_with_a_warning(tmp_path: Path, suffix: str, mark: Callable[[Path], None]) -> None:
    path = tmp_path / f"scene{suffix}"
    write_scene(path, random_scene(20, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        before = read_scene(path)
    mark(path)
    with pytest.warns(SceneWarning, match=r"scene.*anti-aliasing.*too opaque") as caught:
        after = read_scene(path)
    assert len(caught) == 1
    assert after.means.tobytes() == before.means.tobytes()
