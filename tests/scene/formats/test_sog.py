"""PlayCanvas' SOG: its rounding, and its kinds of broken files."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats import read_scene, sog
from pocketgs.scene.morton import morton_order
from scene.formats.scenes import opacity_error, random_scene, turns_between


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_errors(tmp_path: Path, degree: int) -> None:
    scene = random_scene(700, degree, extent=30.0)
    ordered = scene.select(morton_order(scene.means))
    sog.write_gaussians(tmp_path / "a.sog", scene)
    found = read_scene(tmp_path / "a.sog")
    squeezed = [np.sign(each.means) * np.log1p(np.abs(each.means)) for each in (found, ordered)]
    assert (np.abs(squeezed[0] - squeezed[1]) <= np.ptp(squeezed[1], axis=0) / 130_000 + 1e-6).all()
    assert np.abs(found.log_scales - ordered.log_scales).max() <= 0.06
    assert len(np.unique(found.log_scales)) <= 256
    assert turns_between(found, ordered).max() <= 1.0
    assert opacity_error(found, ordered) <= 1 / 500
    assert np.abs(found.sh[:, 0] - ordered.sh[:, 0]).max() <= 0.02
    assert found.sh.shape == ordered.sh.shape
    assert np.abs(found.sh[:, 1:] - ordered.sh[:, 1:]).max(initial=0.0) <= 0.02, "a palette has an entry for each"


def parts_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(path: Path, parts: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


def changed(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """A copy of a file with changes to `meta.json`."""
    parts = parts_of(path)
    meta = json.loads(parts["meta.json"])
    change(meta)
    return packed(path.with_name("changed.sog"), parts | {"meta.json": json.dumps(meta).encode()})


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda meta: meta.update(version=1), "version 1, expected 2"),
        (lambda meta: meta.update(count=0), "0 Gaussians"),
        (lambda meta: meta.update(count=10**8), "MB of memory"),
        (lambda meta: meta.update(count=600), "expected 600 or more"),
        (lambda meta: meta["scales"].update(codebook=["x"] * 256), "not a list of up to 256 numbers"),
        (lambda meta: meta["means"].update(mins=[1e39] * 3), "NaN or infinity"),
        (lambda meta: meta["shN"].update(bands=2), "the palette has"),
        (lambda meta: meta["shN"].update(count=3), "of a palette of 3"),
        (lambda meta: meta["quats"].update(files=["sh0.webp"]), "a rotation has the alpha"),
        (lambda meta: meta["quats"].update(files=["../x"]), "holds no"),
        (lambda meta: meta["quats"].update(files=["meta.json"]), "not a readable image"),
        (lambda meta: meta.pop("sh0"), "lacks 'files' of 'sh0'"),
    ],
)
def test_broken(tmp_path: Path, change: Callable[[dict[str, Any]], object], told: str) -> None:
    sog.write_gaussians(tmp_path / "a.sog", random_scene(100, 1))
    with pytest.raises(PocketGSError, match=told):
        read_scene(changed(tmp_path / "a.sog", change))


def test_names_that_begin_here(tmp_path: Path) -> None:
    """`bsdtar` packs a folder like this."""
    sog.write_gaussians(tmp_path / "a.sog", random_scene(100, 1))
    parts = {f"./{name}": content for name, content in parts_of(tmp_path / "a.sog").items()}
    found = read_scene(packed(tmp_path / "b.sog", parts))
    np.testing.assert_array_equal(found.means, read_scene(tmp_path / "a.sog").means)


def test_a_folder_zipped_as_a_whole(tmp_path: Path) -> None:
    sog.write_gaussians(tmp_path / "a.sog", random_scene(100, 1))
    parts = parts_of(tmp_path / "a.sog")
    inside = {"scene/": b"", **{f"scene/{name}": content for name, content in parts.items()}}
    for more in ({}, {"__MACOSX/scene/._meta.json": b"?"}):
        found = read_scene(packed(tmp_path / "b.sog", inside | more))
        np.testing.assert_array_equal(found.means, read_scene(tmp_path / "a.sog").means)
    with pytest.raises(PocketGSError, match=r"holds no 'meta.json'"):
        read_scene(packed(tmp_path / "b.sog", inside | {"other/meta.json": parts["meta.json"]}))


def test_the_clock_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Boards without a battery start in 1970, which no ZIP file can state."""
    sog.write_gaussians(tmp_path / "a.sog", random_scene(100, 1))
    monkeypatch.setattr("time.time", lambda: 0.0)
    sog.write_gaussians(tmp_path / "b.sog", random_scene(100, 1))
    assert (tmp_path / "a.sog").read_bytes() == (tmp_path / "b.sog").read_bytes()


@pytest.mark.parametrize("outlier", [30.0, 3e3, 1e6, -3e37])
def test_an_outlier_costs_the_others_nothing(tmp_path: Path, outlier: float) -> None:
    scene = random_scene(700, 0)
    scene.log_scales[:] = np.random.default_rng(0).uniform(-9.0, 0.0, (700, 3))
    scene.sh[5, 0, 0], scene.log_scales[6, 1] = outlier, -87.3
    ordered = scene.select(morton_order(scene.means))
    sog.write_gaussians(tmp_path / "a.sog", scene)
    found = read_scene(tmp_path / "a.sog")
    np.testing.assert_allclose(found.sh, ordered.sh, atol=0.02, rtol=1e-6)
    np.testing.assert_allclose(found.log_scales, ordered.log_scales, atol=0.05)


@pytest.mark.parametrize("name", ["scales", "sh0", "shN"])
def test_codebook_without_its_first_number(tmp_path: Path, name: str) -> None:
    """The first number is null in some files: it continues the even steps of the others."""
    sog.write_gaussians(tmp_path / "a.sog", random_scene(700, 1))
    book = np.linspace(-4.0, 1.1, 256).tolist()
    whole = read_scene(changed(tmp_path / "a.sog", lambda meta: meta[name].update(codebook=book)))
    found = read_scene(changed(tmp_path / "a.sog", lambda meta: meta[name].update(codebook=[None, *book[1:]])))
    first = book[1] + (book[1] - book[255]) / 255
    for one, other in ((found.log_scales, whole.log_scales), (found.sh, whole.sh)):
        np.testing.assert_allclose(one, np.where(other == np.float32(-4.0), first, other), atol=1e-6)
    assert (found.log_scales if name == "scales" else found.sh).min() == np.float32(first)


@pytest.mark.parametrize("book", [[None] * 256, [None] + [1.0] * 99, [1.0, None] + [1.0] * 254, [None, True] * 128])
def test_codebook_without_other_numbers(tmp_path: Path, book: list[Any]) -> None:
    sog.write_gaussians(tmp_path / "a.sog", random_scene(100, 1))
    with pytest.raises(PocketGSError, match="not a list of up to 256 numbers"):
        read_scene(changed(tmp_path / "a.sog", lambda meta: meta["scales"].update(codebook=book)))


def test_other_codecs_are_refused(tmp_path: Path) -> None:
    sog.write_gaussians(tmp_path / "a.sog", random_scene(100, 1))
    parts = parts_of(tmp_path / "a.sog")
    assert len(read_scene(packed(tmp_path / "b.sog", parts, zipfile.ZIP_DEFLATED))) == 100
    content = packed(tmp_path / "b.sog", parts, zipfile.ZIP_LZMA).read_bytes()
    broken = content.replace(b"meta.json\x09", b"meta.json\xff", 1)
    for each in (content, broken):
        (tmp_path / "b.sog").write_bytes(each)
        with pytest.raises(PocketGSError, match="compressed by method 14, expected stored or deflated"):
            read_scene(tmp_path / "b.sog")
    buffer = io.BytesIO()
    Image.open(io.BytesIO(parts["quats.webp"])).save(buffer, "TIFF")
    with pytest.raises(PocketGSError, match=r"'quats.webp' is not a readable image"):
        read_scene(packed(tmp_path / "b.sog", parts | {"quats.webp": buffer.getvalue()}))
