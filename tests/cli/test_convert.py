"""`pocketgs convert` and `pocketgs export-colmap`."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.capture import open_capture
from pocketgs.results.cameras_file import write_cameras
from pocketgs.scene.edits import rotated, scaled, translated
from pocketgs.scene.formats import read_scene
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.file import read_sort_free, write_sort_free
from pocketgs.sort_free.scene import sort_free
from scene.formats.scenes import random_scene


@pytest.fixture
def scene(tmp_path: Path) -> Gaussians:
    """A scene that lies in scene.ply, too."""
    made = random_scene(300, 2)
    made.save(tmp_path / "scene.ply")
    return made


def test_less_detail_makes_smaller_files(tmp_path: Path, pocketgs: Callable[..., Any]) -> None:
    random_scene(2000, 1).save(tmp_path / "scene.ply")
    for detail in ("fine", "small"):
        outcome = pocketgs("convert", tmp_path / "scene.ply", tmp_path / f"{detail}.spz", "--detail", detail)
        assert (outcome.status, outcome.errors) == (0, "")
        assert ("does not keep the order of Gaussians or of their axes" in outcome.output) == (detail == "small")
    assert (tmp_path / "small.spz").stat().st_size < 0.8 * (tmp_path / "fine.spz").stat().st_size


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz", ".splat", ".glb"])
def test_every_format(tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians, suffix: str) -> None:
    target = tmp_path / f"out{suffix}"
    outcome = pocketgs("convert", tmp_path / "scene.ply", target)
    assert (outcome.status, outcome.errors) == (0, "")
    assert f"300 Gaussians in {target}, {target.stat().st_size:,} bytes" in outcome.output
    dropped = "does not keep the order of Gaussians, or spherical harmonics above degree 0"
    assert (dropped in outcome.output) == (suffix == ".splat")
    assert ("rounds" in outcome.output) == (suffix != ".ply")
    # And back, through the other commands' way in.
    assert pocketgs("convert", target, tmp_path / "back.ply").status == 0
    assert len(read_scene(tmp_path / "back.ply")) == 300
    assert "300 Gaussians, spherical harmonics of degree" in pocketgs("info", target).output


def test_edits_in_their_order(tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians) -> None:
    options = ["--translate", -1, 2, 3, "--rotate", 10, -20, 30, "--scale", 2, "--sh-degree", 1]
    options += ["--min-opacity", 0.25, "--crop-box", -2, -2, -2, 2.5, 2.5, 2.5]
    outcome = pocketgs("convert", tmp_path / "scene.ply", tmp_path / "out.ply", *options)
    assert (outcome.status, outcome.errors) == (0, "")
    found = read_scene(tmp_path / "out.ply")
    inside = ((scene.means >= -2) & (scene.means <= 2.5)).all(axis=1) & (scene.opacities >= 0.25)
    assert 0 < len(found) == np.count_nonzero(inside) < 300
    expected = scene.select(inside)
    expected.sh = np.ascontiguousarray(expected.sh[:, :4])
    rotation = Rotation.from_euler("xyz", [10, -20, 30], degrees=True).as_matrix()
    expected = translated(rotated(scaled(expected, 2.0), rotation), np.array([-1, 2, 3]))
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-6, atol=1e-6)


def test_turns_are_about_x_then_y_then_z(tmp_path: Path, pocketgs: Callable[..., Any]) -> None:
    scene = random_scene(1, 0)
    scene.means[:] = [[0, 1, 0]]
    scene.save(tmp_path / "scene.ply")
    pocketgs("convert", tmp_path / "scene.ply", tmp_path / "out.ply", "--rotate", 90, 90, 0)
    # y goes to z, and z to x.
    np.testing.assert_allclose(read_scene(tmp_path / "out.ply").means, [[1, 0, 0]], atol=1e-6)


def test_degree_is_not_raised(tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians) -> None:
    pocketgs("convert", tmp_path / "scene.ply", tmp_path / "out.ply", "--sh-degree", 3)
    assert read_scene(tmp_path / "out.ply").sh_degree == 2


@pytest.mark.parametrize(("version", "magic"), [(3, b"\x1f\x8b"), (4, b"NGSP")])
def test_spz_version(
    tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians, version: int, magic: bytes
) -> None:
    pocketgs("convert", tmp_path / "scene.ply", tmp_path / "out.spz", "--spz-version", version)
    assert (tmp_path / "out.spz").read_bytes().startswith(magic)


@pytest.mark.parametrize(
    ("target", "options", "message"),
    [
        ("out.obj", [], "out.obj: not the name of a scene"),
        ("out.gltf", [], "expected a name that ends in .glb"),
        ("none/out.ply", [], "its folder does not exist"),
        ("out.ply", ["--crop-box", 90, 90, 90, 91, 91, 91], "out.ply: none of 300 Gaussians is left"),
        ("out.ply", ["--min-opacity", 1], "none of 300 Gaussians is left"),
        ("out.ply", ["--min-opacity", 2], "minimum opacity 2.0, expected 0 to 1"),
        ("out.ply", ["--crop-box", 1, 0, 0, 0, 1, 1], "expected each minimum at most its maximum"),
        ("out.ply", ["--scale", 0], "scale 0.0, expected a positive number"),
        ("out.ply", ["--rotate", "nan", 0, 0], "expected degrees"),
        ("out.ply", ["--translate", "inf", 0, 0], "expected finite numbers"),
    ],
)
def test_refusals(
    tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians, target: str, options: list[object], message: str
) -> None:
    outcome = pocketgs("convert", tmp_path / "scene.ply", tmp_path / target, *options)
    assert outcome.status == 2
    assert message in outcome.errors
    assert outcome.errors.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.ply"]


def test_missing_scene(tmp_path: Path, pocketgs: Callable[..., Any]) -> None:
    outcome = pocketgs("convert", tmp_path / "scene.spz", tmp_path / "out.ply")
    assert outcome.status == 2
    assert "scene.spz: no such file" in outcome.errors
    outcome = pocketgs("convert", tmp_path / "result", tmp_path / "out.ply")
    assert "result: no such file or folder, expected a scene file or a result folder" in outcome.errors


@pytest.mark.parametrize("command", ["info", "convert"])
def test_scenes_that_cannot_be_read(tmp_path: Path, pocketgs: Callable[..., Any], command: str) -> None:
    """They are not taken for captures. Other programs read a SOG from a folder, too."""
    output = [tmp_path / "out.ply"] if command == "convert" else []
    (tmp_path / "a.ksplat").write_bytes(bytes(4096))
    errors = pocketgs(command, tmp_path / "a.ksplat", *output).errors
    assert "not the name of a scene file, expected one that ends in .compressed.ply" in errors
    random_scene(50, 1).save(tmp_path / "bundle.sog")
    with zipfile.ZipFile(tmp_path / "bundle.sog") as archive:
        archive.extractall(tmp_path / "sog")
    errors = pocketgs(command, tmp_path / "sog", *output).errors
    assert "an unbundled SOG, expected a file: zip what is in the folder as a .sog" in errors


def test_result_folder(tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians) -> None:
    (tmp_path / "result").mkdir()
    scene.save(tmp_path / "result" / "scene.ply")
    assert pocketgs("convert", tmp_path / "result", tmp_path / "out.glb").status == 0
    assert len(read_scene(tmp_path / "out.glb")) == 300


def test_export_colmap(tmp_path: Path, pocketgs: Callable[..., Any], capture_folder: Path) -> None:
    outcome = pocketgs("export-colmap", capture_folder, tmp_path / "model", "--downscale", 2)
    assert (outcome.status, outcome.errors) == (0, "")
    assert f"8 images and cameras, 2,000 points in {tmp_path / 'model'}" in outcome.output
    found = open_capture(tmp_path / "model")
    assert (found.format, len(found.frames), found.frames[0].image.shape) == ("colmap", 8, (36, 48, 3))
    again = pocketgs("export-colmap", capture_folder, tmp_path / "model")
    assert again.status == 2
    assert "expected a new or empty folder" in again.errors


@pytest.mark.parametrize("step", [0.001, 1.0])
def test_export_colmap_with_the_poses_of_a_result(
    tmp_path: Path, pocketgs: Callable[..., Any], capture_folder: Path, step: float
) -> None:
    """Points of another world than the poses' are left out."""
    result = tmp_path / "result"
    result.mkdir()
    random_scene(3, 0).save(result / "scene.ply")
    (result / "run.json").write_text("{}")
    capture = open_capture(capture_folder)
    moved = np.eye(4)
    moved[:3, 3] = np.multiply([1, 2, 3], step)
    frames = [
        replace(frame, camera=replace(frame.camera, world_to_camera=frame.camera.world_to_camera @ moved))
        for frame in capture.frames
    ]
    write_cameras(result / "cameras.json", frames, refined=True)
    outcome = pocketgs("export-colmap", capture_folder, tmp_path / "model", "--poses-of", result)
    points, warning = (
        ("2,000", "") if step < 1 else ("0", f"warning: {result}: the capture's points do not fit its poses")
    )
    assert (outcome.status, outcome.errors[: len(warning)]) == (0, warning)
    assert bool(outcome.errors) == bool(warning)
    assert f"8 images and cameras, {points} points" in outcome.output
    found = sorted(open_capture(tmp_path / "model").frames, key=lambda frame: frame.name)
    for one, other in zip(found, sorted(frames, key=lambda frame: frame.name), strict=True):
        np.testing.assert_allclose(one.camera.world_to_camera, other.camera.world_to_camera, atol=1e-9)


def test_warnings_about_scenes(tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians) -> None:
    path, far = tmp_path / "scene.ply", tmp_path / "far.ply"
    path.write_bytes(path.read_bytes().replace(b"element", b"comment antialiased 1\nelement", 1))
    errors = pocketgs("convert", path, tmp_path / "out.spz").errors
    assert errors.startswith(f"warning: {path}: trained with anti-aliasing")
    assert errors.count("\n") == 1
    means = scene.means.copy()
    means[0, 0] = 1e7
    replace(scene, means=means).save(far)
    errors = pocketgs("convert", far, tmp_path / "far.pgs").errors
    assert errors.startswith(f"warning: {tmp_path / 'far.pgs'}: centres are rounded")


@pytest.mark.parametrize("form", ["visibility", "lc"])
def test_sort_free_gaussians_that_are_not_drawn(tmp_path: Path, pocketgs: Callable[..., Any], form: str) -> None:
    """They are left out with their weights, or because of these."""
    free, broken = sort_free(random_scene(30, 1), form, 2.0), tmp_path / "broken.ply"
    free.gaussians.means[3] = np.nan
    if form == "lc":
        free.visibility_sh[5] = np.inf
    left_out = [3, 5] if form == "lc" else [3]
    write_sort_free(broken, free)
    for name in ("out.ply", "out.pgs"):
        outcome = pocketgs("convert", broken, tmp_path / name)
        assert outcome.status == 0
        found = f"{len(left_out)} of 30 Gaussians hold NaN or infinity and are left out"
        assert f"warning: {broken}: {found}" in outcome.errors
    kept = read_sort_free(tmp_path / "out.ply")
    np.testing.assert_array_equal(kept.visibility_sh, np.delete(free.visibility_sh, left_out, axis=0))


def test_gaussians_that_are_not_drawn(tmp_path: Path, pocketgs: Callable[..., Any], scene: Gaussians) -> None:
    """They are left out, and do not count for what `info` tells; underflowing sizes do."""
    scene.means[3] = np.nan
    scene.log_scales[4, 1] = np.inf
    scene.log_scales[5] = -300.0
    scene.opacity_logits[6] = -200.0
    broken, path = tmp_path / "broken.ply", tmp_path / "out.spz"
    scene.save(broken)
    outcome = pocketgs("convert", broken, path)
    assert outcome.status == 0
    assert f"warning: {broken}: 2 of 300 Gaussians hold NaN or infinity and are left out" in outcome.errors
    assert len(read_scene(path)) == 298
    told = pocketgs("info", broken)
    whole = pocketgs("info", path).output.splitlines()
    assert (told.status, told.errors) == (0, "")
    first, counted, box, *_ = told.output.splitlines()
    assert (first[:13], counted) == ("300 Gaussians", "2 of them hold NaN or infinity, and are left out below")
    assert box == whole[1]
    assert "nan" not in told.output
    scene.means[:] = np.nan
    scene.save(broken)
    assert "300 of them hold NaN" in pocketgs("info", broken).output
    assert "none of 300 Gaussians is left" in pocketgs("convert", broken, path).errors
