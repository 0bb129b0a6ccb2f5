"""Masks: where they are found, how they are matched to photographs, and their effect."""

from __future__ import annotations

import shutil
import tracemalloc
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pocketgs.capture import open_capture
from pocketgs.capture.decoding.mask_file import read_mask
from pocketgs.capture.masks import match_masks
from pocketgs.errors import PocketGSError

MASK = np.zeros((12, 16), np.uint8)
MASK[:, 4:] = 255


def save(path: Path, mask: np.ndarray = MASK) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(mask).save(path)


@pytest.mark.parametrize("folder", ["masks", "mask"])
@pytest.mark.parametrize("name", ["view_{:02d}.png.png", "view_{:02d}.png", "view_{:02d}.JPG", "{:03d}.png"])
def test_masks_are_found_in_the_usual_places(write_transforms, folder, name):
    capture = write_transforms()
    for number in range(10):
        save(capture / folder / name.format(number), np.roll(MASK, number, axis=1))
    opened = open_capture(capture, hold_out=0)
    assert (opened.warnings, opened.protocol) == ((), "16x12, masked, nothing held out")
    for number, frame in enumerate(opened.train):
        np.testing.assert_array_equal(frame.mask, np.roll(MASK, number, axis=1) > 0)
        np.testing.assert_array_equal(frame.usable, frame.mask)


def test_masks_elsewhere_and_none(write_transforms, tmp_path_factory):
    capture, elsewhere = write_transforms(), tmp_path_factory.mktemp("elsewhere")
    for number in range(10):
        save(elsewhere / f"view_{number:02d}.png")
        save(capture / f"people/view_{number:02d}.png", 255 - MASK)
        save(capture / f"masks/view_{number:02d}.png", np.full_like(MASK, 255))
    for masks, mean in ((str(elsewhere), 0.75), ("people", 0.25), ("found", 1.0)):
        assert open_capture(capture, masks=masks).train[0].mask.mean() == mean
    assert open_capture(capture, masks="none").train[0].mask is None
    with pytest.raises(PocketGSError, match="absent: no such folder, expected one with masks"):
        open_capture(capture, masks="absent")
    save(capture / "others/something.png")
    with pytest.raises(PocketGSError, match=r"none of its 1 images is the mask of a frame.* view_00\.png\.png"):
        open_capture(capture, masks="others")


@pytest.mark.parametrize("background", [None, (1.0, 0.5, 0.0)])
def test_outside_masks_a_capture_can_be_empty(write_transforms, background):
    capture = write_transforms()
    for number in range(9):
        save(capture / f"masks/view_{number:02d}.png")
    options = {"background": background, "hold_out": 0}
    whole, cut = (open_capture(capture, **options, outside_masks=outside).train for outside in ("unknown", "empty"))
    for before, after in zip(whole[:9], cut[:9], strict=True):
        assert after.mask is None
        np.testing.assert_array_equal(after.alpha, MASK)
        np.testing.assert_array_equal(after.usable, before.mask)
        np.testing.assert_array_equal(after.image[:, 4:], before.image[:, 4:])
        colour = np.rint(255 * np.array(background or (0.0, 0.0, 0.0)))
        np.testing.assert_array_equal(after.image[:, :4], np.broadcast_to(colour, (12, 4, 3)))
    np.testing.assert_array_equal(cut[9].image, whole[9].image)
    assert cut[9].alpha is None


def test_outside_masks_the_protocol_and_the_errors(write_transforms):
    capture = write_transforms()
    with pytest.raises(PocketGSError, match="has no masks, outside which it could be empty"):
        open_capture(capture, outside_masks="empty")
    with pytest.raises(PocketGSError, match="outside_masks 'black', expected unknown, empty"):
        open_capture(capture, outside_masks="black")
    for number in range(10):
        save(capture / f"masks/view_{number:02d}.png", MASK if number else np.zeros_like(MASK))
    opened = open_capture(capture, outside_masks="empty", hold_out=0)
    assert opened.protocol == "16x12, on black, cut out by masks, nothing held out"
    assert len(opened.train) == 9
    assert opened.warnings[0].startswith(
        f"the masks of 1 of 10 frames leave no pixel, the first {'images/view_00.png'}"
    )


def test_cut_out_photographs_keep_their_own_alpha(write_transforms):
    capture = write_transforms()
    for number in range(10):
        save(capture / f"masks/view_{number:02d}.png")
    opacity = np.full((12, 16), 255, np.uint8)
    opacity[:3] = 100
    first = capture / "images/view_00.png"
    Image.fromarray(np.dstack([np.asarray(Image.open(first).convert("RGB")), opacity])).save(first)
    found = open_capture(capture, outside_masks="empty", hold_out=0).train[0]
    np.testing.assert_array_equal(found.alpha, np.where(MASK > 0, opacity, 0))


def test_cut_outs_take_no_second_copy_of_all_photographs(write_transforms, ring):
    """One that just fits into memory would not."""
    capture = write_transforms()
    for path in (capture / "images").iterdir():
        Image.fromarray(np.zeros((480, 640, 3), np.uint8)).save(path)
        save(capture / "masks" / path.name, np.kron(MASK, np.ones((40, 40), np.uint8)))
    peaks = []
    for outside in ("unknown", "empty"):
        tracemalloc.start()
        open_capture(capture, outside_masks=outside)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]


def test_masks_of_a_capture_given_by_its_file(write_transforms, tmp_path, monkeypatch):
    capture = write_transforms()
    for number in range(10):
        save(capture / f"people/view_{number:02d}.png")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    opened = open_capture(capture / "transforms.json", masks="people")
    assert opened.train[0].mask.mean() == 0.75


def test_accents_in_names_of_masks(ring, write_transforms):
    """The file system of macOS takes accents apart, its other programs do not."""
    composed, apart = (unicodedata.normalize(form, "Caf\u00e9.png") for form in ("NFC", "NFD"))
    frames = ring.transforms()["frames"]
    frames[0]["file_path"] = f"images/{composed}"
    capture = write_transforms(frames=frames)
    (capture / "images/view_00.png").rename(capture / "images" / composed)
    save(capture / "masks" / apart)
    opened = open_capture(capture, hold_out=0)
    assert [frame.name for frame in opened.train if frame.mask is not None] == [f"images/{composed}"]


def test_stated_masks_go_before_found_ones(ring, write_transforms):
    frames = ring.transforms()["frames"]
    frames[0]["mask_path"] = "stated.png"
    capture = write_transforms(frames=frames)
    save(capture / "stated.png")
    save(capture / "masks/view_01.png")
    opened = open_capture(capture, hold_out=0)
    assert [frame.mask is not None for frame in opened.train] == [True] + 9 * [False]
    assert opened.protocol == "16x12, 1 of 10 masked, nothing held out"
    assert all(frame.mask is None for frame in open_capture(capture, masks="none").frames)


def test_frames_without_a_mask_are_used_whole(write_transforms):
    capture = write_transforms()
    for number in range(3):
        save(capture / f"masks/view_{number:02d}.png")
    opened = open_capture(capture)
    assert "no masks for 7 of 10 frames, which are used whole, the first images/view_03.png" in opened.warnings[0]
    assert sum(frame.mask is not None for frame in opened.frames) == 3


def test_masks_that_leave_nothing(write_transforms):
    capture = write_transforms()
    for number in range(10):
        save(capture / f"masks/view_{number:02d}.png", MASK * (number not in (0, 3)))
    opened = open_capture(capture)
    assert len(opened.frames) == 8
    assert "the masks of 2 of 10 frames leave no pixel, the first images/view_00.png" in opened.warnings[0]
    for number in range(10):
        save(capture / f"masks/view_{number:02d}.png", 0 * MASK)
    with pytest.raises(PocketGSError, match=r"leave no pixel.* white where pixels are to be used; no frame is left"):
        open_capture(capture)


def test_masks_of_another_size_and_shape(write_transforms):
    capture = write_transforms()
    save(capture / "masks/view_01.png", np.kron(MASK, np.ones((3, 3), np.uint8)))
    save(capture / "masks/view_02.png", MASK[::2, ::2])
    frames = open_capture(capture, hold_out=0).train
    for number in (1, 2):
        np.testing.assert_array_equal(frames[number].mask, MASK > 0)
    save(capture / "masks/view_02.png", MASK.T)
    opened = open_capture(capture, hold_out=0)
    assert [frame.mask is not None for frame in opened.train[:3]] == [False, True, False]
    found = "the masks of 1 frames have not the shape of their photographs, the first of images/view_02.png"
    assert f"{found}: the frames are used whole" in opened.warnings
    with pytest.raises(PocketGSError, match=r"view_02\.png: mask of 12x16 pixels, expected the shape .* 16x12"):
        open_capture(capture, masks="masks")


def test_broken_masks_are_named(ring, write_transforms):
    """They stop what asks for them, and no other run."""
    capture = write_transforms()
    for number in (1, 2):
        save(capture / f"masks/view_{number:02d}.png")
    whole = (capture / "masks/view_02.png").read_bytes()
    (capture / "masks/view_02.png").write_bytes(whole[: len(whole) // 2])
    opened = open_capture(capture, hold_out=0)
    assert [frame.mask is not None for frame in opened.train[:3]] == [False, True, False]
    [warning] = [warning for warning in opened.warnings if "cannot be used" in warning]
    assert "the masks of 1 frames cannot be used, the first of images/view_02.png: the frames are used whole" in warning
    frames = ring.transforms()["frames"]
    frames[2]["mask_path"] = "masks/view_02.png"
    for masks, folder in (("masks", capture), ("found", write_transforms(frames=frames))):
        with pytest.raises(PocketGSError, match=r"masks.view_02\.png: cannot be decoded"):
            open_capture(folder, masks=masks)


def test_folders_that_fit_nothing_are_no_reason_to_fail(write_transforms):
    capture = write_transforms()
    save(capture / "masks/skin.png")
    opened = open_capture(capture)
    assert "these masks are not used" in opened.warnings[0]
    assert all(frame.mask is None for frame in opened.frames)


def test_masks_go_with_the_images_of_their_model(ring, colmap_files, tmp_path):
    """The originals have the same names as the undistorted images that are used."""
    colmap_files.write(tmp_path / "dense/sparse")
    for folder, mask in (("", 255 - MASK), ("dense", MASK)):
        ring.write_images(tmp_path / folder / "images")
        for name in ring.names:
            save(tmp_path / folder / "masks" / name, mask)
    assert open_capture(tmp_path).train[0].mask.mean() == 0.75
    shutil.rmtree(tmp_path / "dense/masks")
    assert open_capture(tmp_path).train[0].mask.mean() == 0.25
    for name in ring.names:
        save(tmp_path / "masks" / name, np.zeros((1200, 1580), np.uint8))  # 1.25 % narrower
    opened = open_capture(tmp_path)
    assert "mask of 1580x1200 pixels, expected the shape of dense/images/view_00.png, 16x12" in opened.warnings[0]
    assert "these masks are not used" in opened.warnings[0]
    assert opened.train[0].mask is None


def test_masks_in_folders_as_the_photographs(tmp_path):
    names = [f"images/cam{camera}/{number}.jpg" for camera in "ab" for number in range(3)]
    for name in names:
        save(tmp_path / f"masks/{Path(name).parent.name}/{Path(name).name}.png")
    found = match_masks(names, tmp_path / "masks")
    assert {name: mask.parent.name for name, mask in found.items()} == {name: name[7:11] for name in names}
    shutil.rmtree(tmp_path / "masks/camb")
    assert set(match_masks(names, tmp_path / "masks")) == set(names[:3])
    shutil.move(tmp_path / "masks/cama/0.jpg.png", tmp_path / "masks/0.jpg.png")
    with pytest.raises(PocketGSError, match=r"fits both images/cama/0\.jpg and images/camb/0\.jpg"):
        match_masks(names, tmp_path / "masks")


def test_numbers_decide_only_where_all_agree(tmp_path):
    names = [f"images/IMG_{number}.jpg" for number in (7, 8, 9)]
    for number in (7, 8):
        save(tmp_path / f"masks/{number:04d}.png")
    assert match_masks(names, tmp_path / "masks") == {}
    save(tmp_path / "masks/0009.png")
    assert [mask.name for mask in match_masks(names, tmp_path / "masks").values()] == [
        "0007.png",
        "0008.png",
        "0009.png",
    ]
    save(tmp_path / "masks/overview.png")
    assert match_masks(names, tmp_path / "masks") == {}


@pytest.mark.parametrize("colour", [(255, 0, 0), (0, 0, 255), (0, 255, 255)])
@pytest.mark.parametrize("mode", ["RGB", "RGBA", "CMYK"])
def test_colours_count_by_their_brightest_channel(tmp_path, colour, mode):
    mask = np.full((12, 16, 3), 100, np.uint8)
    mask[:, 4:] = colour
    path = tmp_path / ("a.tif" if mode == "CMYK" else "a.png")
    Image.fromarray(mask).convert(mode).save(path)
    np.testing.assert_array_equal(read_mask(path), MASK > 0)


def test_masks_of_eight_bits_written_as_sixteen(tmp_path):
    for scale, count in ((1, 192 - 48), (257, 192 - 48), (0, 0)):
        save(tmp_path / "a.png", MASK.astype(np.uint16) * scale)
        assert read_mask(tmp_path / "a.png").sum() == count


def test_kinds_of_masks(tmp_path):
    """Every way of storing the same mask reads alike."""
    soft = np.where(MASK > 0, 200, 90).astype(np.uint8)
    palette = Image.fromarray(MASK // 255).convert("P")
    palette.putpalette([0, 0, 0, 128, 0, 0])
    cut_out = np.dstack([np.zeros((12, 16, 3), np.uint8), MASK])
    kinds = {
        "zeros and ones.png": Image.fromarray(MASK // 255),
        "bits.png": Image.fromarray(MASK > 0),
        "smoothed.png": Image.fromarray(soft),
        "sixteen.png": Image.fromarray(MASK.astype(np.uint16) * 257),
        "coloured.png": palette,
        "rgb.png": Image.fromarray(np.dstack([MASK] * 3)),
        "cut_out.png": Image.fromarray(cut_out),
        "white_with_alpha.png": Image.fromarray(np.dstack([MASK] * 3 + [np.full_like(MASK, 255)])),
        "lossy.jpg": Image.fromarray(np.kron(MASK, np.ones((8, 8), np.uint8))),
    }
    for name, image in kinds.items():
        image.save(tmp_path / name)
        found = read_mask(tmp_path / name)
        np.testing.assert_array_equal(found[:: len(found) // 12, :: len(found) // 12], MASK > 0, err_msg=name)


@pytest.mark.parametrize("mode", ["RGBA", "LA"])
def test_black_is_not_used_where_alpha_says_nothing(tmp_path, mode):
    """Photographs in which nothing is to be used often come with opaque alpha."""
    for name, grey, used in (("black", 0, False), ("white", 255, True)):
        Image.fromarray(np.full_like(MASK, grey)).convert(mode).save(tmp_path / f"{name}.png")
        assert np.all(read_mask(tmp_path / f"{name}.png") == used)
