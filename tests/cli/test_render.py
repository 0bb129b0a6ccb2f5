"""`pocketgs render`: views, appearances, and files."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from pocketgs import Capture, Gaussians
from pocketgs.cli.commands.render import _nearest, _picture
from pocketgs.errors import counted
from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import Background
from pocketgs.splat.engine import Rendering
from pocketgs.splat.rendering import render, render_all


def pictures_in(folder: Path) -> dict[str, np.ndarray]:
    return {path.name: np.asarray(Image.open(path)) for path in sorted(folder.glob("*.png"))}


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((one / 255.0 - other / 255.0) ** 2)))


@pytest.fixture
def rendered(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> Callable[..., dict[str, np.ndarray]]:
    """A function that renders to images with some options, and returns them by name."""

    def call(*options: object) -> dict[str, np.ndarray]:
        output = tmp_path / "deep" / "rendered"
        outcome = pocketgs("render", result, written_capture, "--output", output, *options)
        assert (outcome.status, outcome.errors) == (0, "")
        pictures = pictures_in(output)
        assert outcome.output == f"{counted(len(pictures), 'view', 'views')} in {output}\n"
        return pictures

    return call


def test_held_out_views_are_those_of_the_run(rendered: Callable[..., Any], result: Path) -> None:
    pictures = rendered("--views", "held-out")
    assert list(pictures) == ["images_0000.png"]
    pair = np.asarray(Image.open(result / "held_out" / "images_0000.png"))
    np.testing.assert_array_equal(pictures["images_0000.png"], pair[:, 96:])


def test_training_views_look_like_their_photographs(rendered: Callable[..., Any], small_capture: Capture) -> None:
    pictures = rendered("--views", "train")
    assert list(pictures) == [f"images_{number:04d}.png" for number in range(1, 8)]
    for frame, picture in zip(small_capture.train, pictures.values(), strict=True):
        similar = [psnr(picture, other.image) for other in small_capture.train]
        assert max(similar) == psnr(picture, frame.image) > 18


@pytest.mark.parametrize("views", ["orbit", "path"])
def test_paths(rendered: Callable[..., Any], small_capture: Capture, views: str) -> None:
    pictures = rendered("--views", views, "--frames", 7)
    assert list(pictures) == [f"{number:04d}.png" for number in range(7)]
    assert all(picture.shape == (72, 96, 3) for picture in pictures.values())
    values = list(pictures.values())
    assert all((one != other).any() for one, other in pairwise(values))
    if views == "path":
        # An open path goes from the first training view to the last.
        assert psnr(values[0], small_capture.train[0].image) > 18
        assert psnr(values[-1], small_capture.train[-1].image) > 18


def test_video(pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path) -> None:
    file = tmp_path / "deep" / "orbit.mp4"
    command = ["render", result, written_capture, "--frames", 6, "--output"]
    assert pocketgs(*command, file, "--fps", 12).status == 0
    assert pocketgs(*command, tmp_path / "pictures").status == 0
    assert [path.name for path in file.parent.iterdir()] == ["orbit.mp4"]
    video = cv2.VideoCapture(str(file))
    assert video.get(cv2.CAP_PROP_FPS) == 12
    for picture in pictures_in(tmp_path / "pictures").values():
        found, frame = video.read()
        assert found
        assert psnr(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB), picture) > 25
    assert not video.read()[0]


def with_a_frame_of(width: int, height: int, capture: Path) -> None:
    document = json.loads((capture / "transforms.json").read_text())
    frame = document["frames"][1]
    frame |= {"w": width, "h": height, "fl_x": 80.0, "fl_y": 80.0, "cx": width / 2, "cy": height / 2}
    Image.open(capture / frame["file_path"]).resize((width, height)).save(capture / frame["file_path"])
    (capture / "transforms.json").write_text(json.dumps(document))


def test_views_that_differ_by_an_odd_row_make_a_video(
    pocketgs: Callable[..., Any], result: Path, capture_folder: Path, tmp_path: Path
) -> None:
    with_a_frame_of(97, 73, capture_folder)
    outcome = pocketgs("render", result, capture_folder, "--views", "train", "--output", tmp_path / "film.mp4")
    assert (outcome.status, cv2.VideoCapture(str(tmp_path / "film.mp4")).read()[1].shape) == (0, (72, 96, 3))


def test_views_of_two_sizes_make_no_video(
    pocketgs: Callable[..., Any], result: Path, capture_folder: Path, tmp_path: Path
) -> None:
    with_a_frame_of(72, 96, capture_folder)
    outcome = pocketgs("render", result, capture_folder, "--views", "train", "--output", tmp_path / "film.mp4")
    assert outcome.status == 2
    found = "film.mp4: found views of 72x96 and of 96x72, expected one size in a video: name a folder, or --views path"
    assert found in outcome.errors
    assert not (tmp_path / "film.mp4").exists()


@pytest.mark.parametrize(
    ("output", "options", "message"),
    [
        ("film.MOV", [], "film.MOV: cannot be written, expected a name that ends in .mp4, or that of a folder"),
        ("film.gif", [], "cannot be written"),
        ("view.png", [], "cannot be written"),
        (
            "views",
            ["--views", "train", "--frames", 9],
            "--frames concerns an orbit or a path: expected --views orbit or",
        ),
        ("views", ["--fps", 9], "--fps concerns a video: expected an output that ends in .mp4 with it"),
    ],
)
def test_what_is_refused_before_the_work(
    pocketgs: Callable[..., Any], tmp_path: Path, output: str, options: list[object], message: str
) -> None:
    outcome = pocketgs("render", "no result", "no capture", "--output", tmp_path / output, *options)
    assert outcome.status == 2
    assert message in outcome.errors
    assert not (tmp_path / output).exists()


def test_depth_and_alpha_are_grey(rendered: Callable[..., Any], small_capture: Capture) -> None:
    for show in ("depth", "alpha"):
        (picture,) = rendered("--views", "held-out", "--show", show).values()
        np.testing.assert_array_equal(picture, np.repeat(picture[:, :, :1], 3, axis=2))
        if show == "alpha":
            assert picture.mean() > 150
        else:
            # Near is bright.
            depth = small_capture.held_out[0].depth
            assert depth is not None
            near = depth < np.quantile(depth, 0.2)
            assert picture[near].mean() > 1.2 * picture[depth > np.quantile(depth, 0.8)].mean()


class Moving:
    """A wall at a distance of 10, and a post at 2 that only the later views of an orbit show."""

    def render(self, camera: Camera, background: Background = (0, 0, 0), depth: bool = False) -> Rendering:
        found = np.full((camera.height, camera.width), 10.0, np.float32)
        found[:, :2] = 0.0
        if camera.fx > 50:
            found[:, 10:13] = 2.0
        return Rendering(np.zeros((*found.shape, 3), np.float32), (found > 0).astype(np.float32), found)


def test_depth_has_one_scale_for_all_views() -> None:
    """A video would flicker where a near thing comes into view."""
    cameras = [Camera(40, 30, fx, 50.0, 20.0, 15.0, np.eye(4)) for fx in np.linspace(1, 100, 50)]
    nearest = _nearest(Moving(), cameras, (0.0, 0.0, 0.0))
    pictures = [_picture(Moving().render(camera), "depth", nearest) for camera in (cameras[0], cameras[-1])]
    for picture in pictures:
        assert np.unique(picture[:, 20:]).tolist() == [round(255 * 2 / 10)]
        assert not picture[:, :2].any()
    assert np.unique(pictures[1][:, 10:13]).tolist() == [255]


@pytest.mark.parametrize("covered", [0, 1, 8])
def test_depth_of_small_things_is_scaled_by_them(covered: int) -> None:
    class Small:
        def render(self, camera: Camera, background: Background = (0, 0, 0), depth: bool = False) -> Rendering:
            found = np.zeros((camera.height, camera.width), np.float32)
            found[0, :covered] = 100.0
            return Rendering(np.zeros((*found.shape, 3), np.float32), (found > 0).astype(np.float32), found)

    camera = Camera(40, 30, 50.0, 50.0, 20.0, 15.0, np.eye(4))
    picture = _picture(Small().render(camera), "depth", _nearest(Small(), [camera], (0.0, 0.0, 0.0)))
    assert picture.max() == (255 if covered else 0)
    assert np.count_nonzero(picture[..., 0]) == covered


def test_other_files_of_the_folder_stay(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    before = contents(result)
    pocketgs("render", result, written_capture, "--frames", 2, "--output", result)
    after = contents(result)
    assert sorted(set(after) - set(before)) == ["0000.png", "0001.png"]
    before.pop(".pocketgs/manifest.json")
    assert {name: after[name] for name in before} == before


def test_pictures_of_an_earlier_rendering_go(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    """Those of other programs stay; those that were changed are nobody's to delete, and stop the command."""
    output = tmp_path / "views"
    command = ["render", result, written_capture, "--output", output, "--frames"]
    assert pocketgs(*command, 4).status == 0
    Image.new("RGB", (4, 4)).save(output / "mine.png")
    assert pocketgs(*command, 2).status == 0
    assert list(pictures_in(output)) == ["0000.png", "0001.png", "mine.png"]
    assert pocketgs("eval", result, written_capture, "--pictures", output).status == 0
    assert list(pictures_in(output)) == ["images_0000.png", "mine.png"]
    Image.new("RGB", (4, 4)).save(output / "images_0000.png")
    outcome = pocketgs(*command, 2)
    assert outcome.status == 2
    assert "images_0000.png: has been changed since pocketgs wrote it" in outcome.errors
    assert list(pictures_in(output)) == ["images_0000.png", "mine.png"]


def test_pictures_in_a_result_replace_none_of_its_own(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path
) -> None:
    before = [path.name for path in (result / "held_out").iterdir()]
    for frames in (3, 1):
        assert pocketgs("render", result, written_capture, "--frames", frames, "--output", result).status == 0
    assert list(pictures_in(result)) == ["0000.png"]
    assert [path.name for path in (result / "held_out").iterdir()] == before


def test_empty_scene_shows_the_background(small_capture: Capture) -> None:
    empty = Gaussians(*(np.zeros((0, *tail)) for tail in [(3,), (3,), (4,), (), (1, 3)]))
    rendering = render(empty, small_capture.held_out[0].camera, (0.0, 0.5, 1.0), depth=True)
    assert np.all(rendering.image == np.float32([0.0, 0.5, 1.0]))
    assert rendering.depth is not None
    assert not rendering.depth.any()
    assert not rendering.alpha.any()


def test_render_all_is_render_for_each(result: Path, small_capture: Capture) -> None:
    scene = Gaussians.load(result / "scene.ply")
    cameras = [frame.camera for frame in small_capture.frames[:3]]
    for camera, together in zip(cameras, render_all(scene, cameras, depth=True), strict=True):
        alone = render(scene, camera, depth=True)
        np.testing.assert_array_equal(together.image, alone.image)
        np.testing.assert_array_equal(together.alpha, alone.alpha)
        np.testing.assert_array_equal(together.depth, alone.depth)
