"""Reading photographs: features at a reduced size, and arbitrary EXIF data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pocketgs.files.memory_bound import memory_bound
from pocketgs.structure_from_motion import process
from pocketgs.structure_from_motion.exif import read_exif
from pocketgs.structure_from_motion.photographs import Photograph, cameras_of, focal_length, read_photographs

CAMERA, FOCAL, FOCAL_35, WIDTH, HEIGHT, RESOLUTION, UNIT = 0x110, 0x920A, 0xA405, 0xA002, 0xA003, 0xA20E, 0xA210


def textured(width: int, height: int) -> Image.Image:
    noise = np.random.default_rng(0).integers(0, 256, (height // 8, width // 8, 3), dtype=np.uint8)
    return Image.fromarray(noise).resize((width, height), Image.Resampling.BICUBIC)


def with_exif(details: dict[int, object], gps: dict[int, object] | None = None) -> Image.Exif:
    exif = Image.Exif()
    exif[CAMERA] = "Phone"
    exif.get_ifd(0x8769).update(details)
    exif.get_ifd(0x8825).update(gps or {})
    return exif


def written(folder: Path, exif: Image.Exif | bytes, name: str = "a.jpg", size: tuple[int, int] = (320, 240)) -> Path:
    folder.mkdir(exist_ok=True)
    textured(*size).save(folder / name, exif=exif)
    return folder / name


def read(images: Path, tmp_path: Path, max_size: int) -> list[Photograph]:
    workspace = tmp_path / "work"
    workspace.mkdir(exist_ok=True)
    return read_photographs(images, tmp_path / "masks", workspace, max_size, 2, lambda done, of: None)


def test_threads_keep_to_half_of_the_free_memory_and_to_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels, free = 1600 * 1200, 64e9
    monkeypatch.setattr(process, "usable_cores", lambda: 8)
    monkeypatch.setattr(process, "resident_bytes", lambda: 300e6)
    monkeypatch.setattr(process, "free_memory", lambda: free)
    found = []
    for megabytes in (100, 900, 1500, 2100, 64_000):
        with memory_bound(megabytes):
            found.append(process.threads_that_fit(pixels))
    assert found == [1, 1, 2, 3, 8]
    free = 2.4e9
    with memory_bound(64_000):
        assert process.threads_that_fit(pixels) == 2


def test_features_are_sought_in_a_smaller_copy(tmp_path: Path) -> None:
    written(tmp_path / "images", b"")
    (small,) = read(tmp_path / "images", tmp_path, 160)
    assert (small.size, small.reduced_size) == ((320, 240), (160, 120))
    with np.load(small.file) as stored:
        assert stored["keypoints"].shape == (small.features, 4)
        assert stored["colours"].shape == (small.features, 3)
        assert stored["keypoints"][:, :2].max(axis=0) == pytest.approx([160, 120], abs=12)
    assert small.features > 30


def test_no_features_where_a_mask_says_no(tmp_path: Path) -> None:
    written(tmp_path / "images", b"")
    mask = np.zeros((120, 160), np.uint8)
    mask[:, :80] = 255
    (tmp_path / "masks").mkdir()
    Image.fromarray(mask).save(tmp_path / "masks" / "a.jpg.png")
    (found,) = read(tmp_path / "images", tmp_path, 640)
    with np.load(found.file) as stored:
        assert len(stored["keypoints"]) > 30
        assert stored["keypoints"][:, 0].max() <= 160


def test_no_features_where_a_photograph_is_transparent(tmp_path: Path) -> None:
    picture = textured(320, 240)
    picture.putalpha(Image.fromarray(np.where(np.arange(320) < 160, 128, 127)[None].repeat(240, 0).astype(np.uint8)))
    (tmp_path / "images").mkdir()
    picture.save(tmp_path / "images/a.png")
    (found,) = read(tmp_path / "images", tmp_path, 160)
    with np.load(found.file) as stored:
        assert len(stored["keypoints"]) > 15
        assert stored["keypoints"][:, 0].max() <= 80


def test_damaged_photographs_are_left_out(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        path = written(tmp_path / "images", b"", name)
    path.write_bytes(path.read_bytes()[:2000])
    assert [photograph.name for photograph in read(tmp_path / "images", tmp_path, 640)] == ["a.jpg", "b.jpg"]


@pytest.mark.parametrize(
    ("details", "expected"),
    [
        ({FOCAL_35: 26}, 26 / 43.267 * 400),
        ({FOCAL: 4.0, RESOLUTION: 6000.0, UNIT: 3, WIDTH: 4000, HEIGHT: 3000}, 4.0 * 600 / 5000 * 400),
        ({FOCAL_35: 0}, None),
        ({FOCAL: 4.2}, None),
        ({FOCAL_35: 60_000}, None),
    ],
)
def test_focal_length(tmp_path: Path, details: dict[int, object], expected: float | None) -> None:
    written(tmp_path / "images", with_exif(details))
    (photograph,) = read(tmp_path / "images", tmp_path, 640)
    found, is_known = focal_length(photograph)
    assert is_known == (expected is not None)
    assert found == pytest.approx(expected or 0.64 * 400, rel=1e-3)


def test_a_zoomed_photograph_has_a_camera_of_its_own(tmp_path: Path) -> None:
    images = tmp_path / "images"
    for name, focal in (("a.jpg", 4.2), ("b.jpg", 9.0), ("c.jpg", 4.2)):
        written(images, with_exif({FOCAL: focal}), name)
    written(images, with_exif({FOCAL: 4.2}), "d.jpg", (240, 320))
    groups = cameras_of(read(images, tmp_path, 320))
    assert [[photograph.name for photograph in group] for group in groups] == [["a.jpg", "c.jpg"], ["b.jpg"], ["d.jpg"]]


def test_a_crop_is_zoom_too(tmp_path: Path) -> None:
    """Phones scale up the middle of the picture, and state the lens's own focal length beside the equivalent one."""
    images = tmp_path / "images"
    for name, equivalent in (("a.jpg", 26), ("b.jpg", 52), ("c.jpg", 26)):
        written(images, with_exif({FOCAL: 4.2, FOCAL_35: equivalent}), name)
    groups = cameras_of(read(images, tmp_path, 320))
    assert [[photograph.name for photograph in group] for group in groups] == [["a.jpg", "c.jpg"], ["b.jpg"]]


def test_gps(tmp_path: Path) -> None:
    gps = {1: "S", 2: (41.0, 30.0, 36.0), 3: "E", 4: (174.0, 0.0, 0.0), 5: b"\x01", 6: 12.5}
    with Image.open(written(tmp_path, with_exif({}, gps))) as image:
        assert read_exif(image).place == pytest.approx((-41.51, 174.0, -12.5))


@pytest.mark.parametrize("gps", [{}, {2: (1.0, 2.0, 3.0)}, {1: "N", 2: (0.0, 0, 0), 3: "E", 4: (0.0, 0, 0), 6: 5.0}])
def test_gps_that_is_not_there(tmp_path: Path, gps: dict[int, object]) -> None:
    with Image.open(written(tmp_path, with_exif({}, gps))) as image:
        assert read_exif(image).place is None


@pytest.mark.filterwarnings("ignore:.*EXIF.*", "ignore:.*Truncated.*")
@pytest.mark.parametrize("length", [6, 20, 60])
def test_damaged_exif_data_are_ignored(tmp_path: Path, length: int) -> None:
    whole = with_exif({FOCAL_35: 26}, {1: "N", 2: (1.0, 2.0, 3.0), 3: "E", 4: (1.0, 2.0, 3.0), 6: 5.0}).tobytes()
    with Image.open(written(tmp_path, whole[:length])) as image:
        read_exif(image)


def test_west_and_east(tmp_path: Path) -> None:
    """37 degrees north and 122 west are in California; east, they are in the Yellow Sea."""
    for reference, longitude in (("W", -122.5), ("w\0", -122.5), ("E", 122.5)):
        gps: dict[int, object] = {1: "N", 2: (37.0, 30.0, 0.0), 3: reference, 4: (122.0, 30.0, 0.0), 5: b"\0", 6: 12.0}
        place = read_exif(Image.open(written(tmp_path, with_exif({}, gps)))).place
        assert place == (37.5, longitude, 12.0)
