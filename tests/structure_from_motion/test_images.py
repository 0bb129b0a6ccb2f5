"""Gathering photographs: copies never touch the originals, and what is no input is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from PIL import Image

from capture.cut_off_video import write_cut_off
from capture.photographs import PICTURE, on_its_side
from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion.images import gather, source_files
from pocketgs.structure_from_motion.options import PoseOptions


def gathered(source: Path, tmp_path: Path) -> dict[str, Path]:
    """The copies by name."""
    gather(source, tmp_path / "images", PoseOptions(), 2, lambda done, of: None)
    return {path.name: path for path in (tmp_path / "images").iterdir()}


def write_heic(path: Path) -> None:
    """Without registering the format with Pillow, which the code under test does."""
    noise = np.random.default_rng(0).integers(0, 256, (300, 400, 3), dtype=np.uint8)
    pillow_heif.from_pillow(Image.fromarray(noise)).save(path.with_suffix(".tmp"))
    path.with_suffix(".tmp").rename(path)


def test_originals_are_never_written_to(tmp_path: Path) -> None:
    """Copies may be hard links, so no other copy may have the name of one."""
    source = tmp_path / "photographs"
    source.mkdir()
    for stem in ("a", "b"):
        write_heic(source / f"{stem}.HEIC")
        for name in (f"{stem.upper()}.HEIC.jpg", f"{stem.upper()}.JPG"):
            Image.fromarray(PICTURE).save(source / name)
    before = {path.name: path.read_bytes() for path in source.iterdir()}
    copies = gathered(source, tmp_path)
    assert {path.name: path.read_bytes() for path in source.iterdir()} == before
    assert sorted(copies) == ["A.HEIC.jpg", "A.JPG", "B.HEIC.jpg", "B.JPG", "a_2.jpg", "b_2.jpg"]
    assert Image.open(copies["a_2.jpg"]).size == (400, 300)


def test_other_formats_of_photographs_are_left_out(tmp_path: Path) -> None:
    """They would be views of their own: some were held out, and their twins trained on."""
    source, warnings = tmp_path / "photographs", list[str]()
    source.mkdir()
    for number in range(3):
        write_heic(source / f"{number}.HEIC")
        for name in (f"{number}.jpg", f"{number}.HEIC.png"):
            Image.fromarray(PICTURE).save(source / name)
    for name in ("3.jpg", "3.jpeg", "4.webp"):  # two photographs of one format, and one in another
        Image.fromarray(PICTURE).save(source / name)
    (source / "4.HEIC").touch()  # a cloud has not transferred it yet
    gather(source, tmp_path / "images", PoseOptions(), 2, lambda done, of: None, warnings.append)
    assert len(list((tmp_path / "images").iterdir())) == 6
    said = "7 images are other formats of the same photographs and left out, such as 0.HEIC.png"
    assert warnings == [said]


def test_alpha_is_kept(tmp_path: Path) -> None:
    source = tmp_path / "photographs"
    source.mkdir()
    alpha = np.where(np.arange(64) < 32, 255, 0)[None, :, None].repeat(48, axis=0)
    cut_out = Image.fromarray(np.concatenate([PICTURE, alpha], axis=2).astype(np.uint8))
    cut_out.save(source / "a.webp", lossless=True)
    cut_out.save(source / "b.png", exif=on_its_side())
    Image.fromarray(PICTURE).save(source / "c.webp")
    copies = gathered(source, tmp_path)
    assert sorted(copies) == ["a.png", "b.png", "c.jpg"]
    np.testing.assert_array_equal(np.asarray(Image.open(copies["a.png"]))[..., 3:], alpha)
    np.testing.assert_array_equal(np.asarray(Image.open(copies["b.png"]))[..., 3:], np.rot90(alpha, -1))


def test_formats_go_by_content(tmp_path: Path) -> None:
    source = tmp_path / "photographs"
    source.mkdir()
    write_heic(source / "a.JPG")
    Image.fromarray(PICTURE).save(source / "b.png", "JPEG")
    Image.fromarray(PICTURE).save(source / "c.jfif", "JPEG")
    copies = gathered(source, tmp_path)
    assert sorted(copies) == ["a.JPG", "b.png", "c.jfif"]
    assert {Image.open(path).format for path in copies.values()} == {"JPEG"}


def test_a_video_that_was_cut_off_is_told(tmp_path: Path) -> None:
    video, warnings = tmp_path / "walk.mp4", list[str]()
    write_cut_off(video)
    gather(video, tmp_path / "images", PoseOptions(), 2, lambda done, of: None, warnings.append)
    frames = len(list((tmp_path / "images").iterdir()))
    assert [f"ends after {frames} of 90 frames" in warning for warning in warnings] == [True]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["a/1.jpg", "b/1.jpg", "b/2.jpg"], r"in several folders, a \(1\), b \(2\): move them to one, or name one"),
        (["a.mp4", "b.MOV", "._c.mp4"], r"it holds several videos, a\.mp4, b\.MOV: name one"),
        (["scan.zip"], r"it holds scan\.zip: unpack archives first"),
        (["1.dng", "2.DNG", "3.nef"], r"3 other pictures are not read \(\.dng, \.nef\)"),
    ],
)
def test_what_is_there_instead_of_photographs(tmp_path: Path, names: list[str], said: str) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(PocketGSError, match=rf"0 photographs; .*{said}, expected a video or a folder"):
        source_files(tmp_path)


def test_a_single_photograph(tmp_path: Path) -> None:
    Image.fromarray(PICTURE).save(tmp_path / "a.jpg")
    with pytest.raises(PocketGSError, match="1 photograph, expected a video or a folder with at least 3"):
        source_files(tmp_path)
