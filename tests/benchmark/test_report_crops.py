"""The crops of held-out views that a report shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from pocketgs.benchmark.crops import CROP, choose_crop
from pocketgs.benchmark.results import CellResult

MakeResult = Callable[..., CellResult]
Leave = Callable[[CellResult, Mapping[str, np.ndarray]], Path]


def pair(height: int = 300, width: int = 400, spot: tuple[int, int] | None = None) -> np.ndarray:
    """A photograph of a slope of grey beside a rendering like it, but for a red spot of 40 pixels, its middle given."""
    slope = np.broadcast_to(np.linspace(0, 200, width).astype(np.uint8)[:, None], (height, width, 3))
    rendered = slope.copy()
    if spot:
        top, left = spot[0] - 20, spot[1] - 20
        rendered[top : top + 40, left : left + 40] = (255, 0, 0)
    return np.concatenate([slope, rendered], axis=1)


def test_it_shows_where_methods_differ(made_result: MakeResult, leave_pictures: Leave) -> None:
    results = [made_result(), made_result(method="no-dense")]
    spotted = pair(spot=(150, 300))
    leave_pictures(results[0], {"images_a": pair(), "images_b": pair()})
    folder = leave_pictures(results[1], {"images_a": pair(), "images_b": spotted})
    crop = choose_crop(results, "fern", folder)
    assert crop is not None
    assert crop.view == "images_b"
    assert crop.top <= 130
    assert crop.top + CROP[1] >= 170
    assert crop.left <= 280
    assert crop.left + CROP[0] >= 320
    rows, columns = slice(crop.top, crop.top + CROP[1]), slice(crop.left, crop.left + CROP[0])
    np.testing.assert_array_equal(crop.photo, spotted[:, :400][rows, columns])
    assert list(crop.renderings) == ["pocketgs", "no-dense"]
    np.testing.assert_array_equal(crop.renderings["pocketgs"], spotted[:, :400][rows, columns])
    np.testing.assert_array_equal(crop.renderings["no-dense"], spotted[:, 400:][rows, columns])
    assert crop.psnr == {"pocketgs": 28.5, "no-dense": 28.5}


def test_of_one_method_it_shows_the_most_detail(made_result: MakeResult, leave_pictures: Leave) -> None:
    detailed = pair()
    detailed[250:290, 10:50] = np.random.default_rng(0).integers(0, 255, (40, 40, 3))
    crop = choose_crop([made_result()], "fern", leave_pictures(made_result(), {"images_a": detailed}))
    assert crop is not None
    assert crop.top >= 290 - CROP[1]
    assert crop.left <= 10
    assert crop.photo.shape == (CROP[1], CROP[0], 3)


def test_a_small_picture_is_shown_whole(made_result: MakeResult, leave_pictures: Leave) -> None:
    small = pair(height=60, width=80)
    crop = choose_crop([made_result()], "fern", leave_pictures(made_result(), {"images_a": small}))
    assert crop is not None
    np.testing.assert_array_equal(crop.photo, small[:, :80])


def test_methods_with_other_pictures_are_left_out(made_result: MakeResult, leave_pictures: Leave) -> None:
    results = [made_result(method=name) for name in ("pocketgs", "no-seeding", "no-bundle", "no-dense")]
    leave_pictures(results[0], {"images_a": pair()})
    leave_pictures(results[1], {"images_a": pair(height=240)})
    folder = leave_pictures(results[2], {"images_c": pair()})
    crop = choose_crop(results, "fern", folder)
    assert crop is not None
    assert list(crop.renderings) == ["pocketgs"]


def test_without_pictures_there_is_no_crop(made_result: MakeResult, tmp_path: Path) -> None:
    assert choose_crop([made_result()], "fern", tmp_path / "nowhere") is None


def test_pictures_of_another_run_are_left_out(made_result: MakeResult, leave_pictures: Leave) -> None:
    results = [made_result(seed=0), made_result(seed=1, psnr=28.2), made_result(method="no-dense")]
    leave_pictures(results[1], {"images_a": pair()})
    folder = leave_pictures(results[2], {"images_a": pair()})
    for text in (None, "{", "[]", '{"psnr": 27.9}'):
        if text is not None:
            (folder / "fern.no-dense.0" / "run.json").write_text(text)
        crop = choose_crop(results, "fern", folder)
        assert crop is not None
        assert list(crop.renderings) == (["pocketgs", "no-dense"] if text is None else ["pocketgs"])
    (folder / "fern.pocketgs.1" / "run.json").unlink()
    assert choose_crop(results, "fern", folder) is None


@pytest.mark.parametrize("left", [0, 20, 100])
def test_a_view_with_a_damaged_picture_is_left_out(made_result: MakeResult, leave_pictures: Leave, left: int) -> None:
    results = [made_result(), made_result(method="no-dense")]
    leave_pictures(results[0], {"images_a": pair(), "images_b": pair()})
    folder = leave_pictures(results[1], {"images_a": pair(), "images_b": pair(spot=(150, 300))})
    damaged = folder / "fern.no-dense.0" / "held_out" / "images_b.png"
    damaged.write_bytes(damaged.read_bytes()[:left])
    crop = choose_crop(results, "fern", folder)
    assert crop is not None
    assert (crop.view, list(crop.renderings)) == ("images_a", ["pocketgs", "no-dense"])
    damaged.rename(damaged.with_name("images_a.png"))
    (folder / "fern.pocketgs.0" / "held_out" / "images_b.png").unlink()
    assert choose_crop(results, "fern", folder) is None
