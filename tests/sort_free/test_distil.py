"""Distilling improves on its start, gives the same bits, keeps what there is when stopped, and is kept in files."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.cli import main
from pocketgs.cli.own_views import rendered_capture
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound
from pocketgs.geometry.camera import Camera
from pocketgs.metrics.evaluation import psnr
from pocketgs.results.cameras_file import write_cameras
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.sort_free.distil import Distilled, DistilOptions, _d_log_depth, distil
from pocketgs.sort_free.drawing import SortFreeDrawing
from pocketgs.sort_free.file import is_sort_free, read_sort_free, write_sort_free
from pocketgs.sort_free.forms import FORMS, FormName
from pocketgs.sort_free.renderer import SortFreeRenderer
from pocketgs.sort_free.scene import SortFreeScene, sort_free
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.splat.rendering import render
from pocketgs.training.train import train

CPU = EngineOptions("cpu")


@pytest.fixture(scope="module")
def teacher(small_capture: Capture) -> Gaussians:
    scene = train(small_capture, engine="cpu", iterations=60, prior="none", max_gaussians=1500, effort="quick").scene
    return scene.select(morton_order(scene.means))


def closeness(scene: SortFreeScene, capture: Capture) -> float:
    drawing = SortFreeDrawing(scene)
    frame = capture.held_out[0]
    image = np.clip(drawing.render(frame.camera, capture.background).image, 0.0, 1.0)
    return psnr(image, frame.image / 255.0, frame.mask)


def test_what_a_file_cannot_hold_is_refused_before_training(
    tmp_path: Path, teacher: Gaussians, capsys: pytest.CaptureFixture[str]
) -> None:
    distant = teacher.select(np.arange(len(teacher)))
    distant.means[0] = 3e38
    distant.save(tmp_path / "scene.ply")
    with pytest.raises(SystemExit) as left:
        main(["distil", str(tmp_path / "scene.ply"), "no-capture", "--output", str(tmp_path / "small.pgs")])
    assert left.value.code == 2
    assert "a coordinate of 3e+38" in capsys.readouterr().err


@pytest.mark.parametrize("form", FORMS)
def test_training_improves_every_form(small_capture: Capture, teacher: Gaussians, form: str) -> None:
    options = DistilOptions(form, iterations=0)  # type: ignore[arg-type]
    start = distil(teacher, small_capture, options).scene
    found = distil(teacher, small_capture, replace(options, iterations=25)).scene
    assert closeness(found, small_capture) > closeness(start, small_capture) + 0.2


def test_what_is_seen_is_a_good_start(small_capture: Capture, teacher: Gaussians) -> None:
    """Better than equal weights, where distances do not count."""
    scene = distil(teacher, small_capture, DistilOptions(iterations=0, view_degree=1)).scene
    fitted = replace(scene, log_shared=np.log([1e-6]))
    flat = replace(fitted, visibility_sh=np.zeros_like(fitted.visibility_sh))
    frame = small_capture.train[0]
    wanted = render(teacher, frame.camera, small_capture.background, engine=CPU).image
    errors = [
        np.abs(SortFreeDrawing(scene).render(frame.camera, small_capture.background).image - wanted).mean()
        for scene in (fitted, flat)
    ]
    assert errors[0] < 0.85 * errors[1]


def test_it_gives_the_same_bits_on_any_number_of_threads(small_capture: Capture, teacher: Gaussians) -> None:
    options = DistilOptions(iterations=4, engine="cpu")
    one, other = (distil(teacher, small_capture, replace(options, threads=n)).scene for n in (1, 2))
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        assert getattr(one.gaussians, name).tobytes() == getattr(other.gaussians, name).tobytes(), name
    assert one.visibility_sh.tobytes() == other.visibility_sh.tobytes()
    assert one.log_shared.tobytes() == other.log_shared.tobytes()


@pytest.mark.parametrize("form", ["visibility", "lc"])
def test_a_gpu_distils_as_the_cpu_does(small_capture: Capture, teacher: Gaussians, form: FormName) -> None:
    scenes = [
        distil(teacher, small_capture, DistilOptions(form, iterations=8, engine=name)).scene
        for name in ("cpu", "webgpu")
    ]
    ours, gpus = (closeness(scene, small_capture) for scene in scenes)
    assert abs(ours - gpus) < 0.02
    # Adam's first steps have the rates' size whatever the gradient's, so what differs are signs of tiny gradients.
    moved = np.abs(scenes[0].gaussians.means - scenes[1].gaussians.means)
    assert np.median(moved) < 1e-3 * np.abs(scenes[0].gaussians.means - teacher.means).max()


def test_ctrl_c_keeps_what_there_is(small_capture: Capture, teacher: Gaussians) -> None:
    def press(stage: str, done: int, of: int) -> None:
        if stage == "training" and done == 2:
            signal.raise_signal(signal.SIGINT)

    found: Distilled = distil(teacher, small_capture, DistilOptions("direct", iterations=50), press)
    assert (found.iterations, found.interrupted) == (2, True)


@pytest.mark.parametrize("form", FORMS)
def test_files_hold_everything(tmp_path: Path, teacher: Gaussians, form: str) -> None:
    scene = sort_free(teacher, form, 3.7, view_degree=2)
    scene.visibility_sh[:] = np.random.default_rng(0).normal(size=scene.visibility_sh.shape)
    write_sort_free(tmp_path / "scene.ply", scene)
    assert is_sort_free(tmp_path / "scene.ply")
    found = read_sort_free(tmp_path / "scene.ply")
    assert found.visibility_sh.tobytes() == scene.visibility_sh.tobytes()
    assert found.gaussians.sh.tobytes() == scene.gaussians.sh.tobytes()
    assert (found.form.name, found.unit) == (form, 3.7)
    np.testing.assert_allclose(found.log_shared, scene.log_shared, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["teacher_weight", "depth_weight"])
@pytest.mark.parametrize("weight", [-1.0, np.inf, np.nan])
def test_weights_are_checked(name: str, weight: float) -> None:
    with pytest.raises(PocketGSError, match=f"{name[:5]}.* weight: found {weight}, expected a finite number"):
        DistilOptions(**{name: weight})


def test_files_hold_whatever_was_learned(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, small_capture: Capture, teacher: Gaussians
) -> None:
    monkeypatch.setattr("pocketgs.sort_free.distil.NUMBER_RATE", 1000.0)
    scene = distil(teacher, small_capture, DistilOptions("exponential", iterations=1)).scene
    scene.unit = np.float64(3.7)
    write_sort_free(tmp_path / "scene.ply", scene)
    found = read_sort_free(tmp_path / "scene.ply")
    np.testing.assert_allclose(found.log_shared, scene.log_shared, atol=1e-12)
    assert np.abs(found.log_shared).max() > 19.0
    scene.log_shared[0] = 21.0
    with pytest.raises(PocketGSError, match="expected such that float32 can hold"):
        write_sort_free(tmp_path / "other.ply", scene)
    assert not (tmp_path / "other.ply").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"comment sort_free_unit 3.7", b"comment sort_free_unit -1", "'sort_free_unit' is '-1', expected a positive"),
        (b"comment sort_free_unit 3.7", b"comment sort_free_unit 1e-30", "unit 1e-30 and numbers"),
        (b"comment sort_free_sigma", b"comment sort_free_sigh", "'sort_free_sigma' is None, expected a positive"),
        (b"comment sort_free visibility", b"comment sort_free magic", "form 'magic': not known, expected one of"),
        (b"property float view_3", b"property float view_9", r"views of shape \(\d+, 3\), expected"),
        (b"element vertex", b"element vortex", "not a readable .ply with vertices"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, teacher: Gaussians, old: bytes, new: bytes, message: str) -> None:
    path = tmp_path / "scene.ply"
    write_sort_free(path, sort_free(teacher, "visibility", 3.7))
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))
    with pytest.raises(PocketGSError, match=message) as raised:
        read_sort_free(path)
    assert str(path) in str(raised.value)


def test_the_commands(
    written_capture: Path, teacher: Gaussians, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    teacher.save(tmp_path / "teacher.ply")
    output, given = tmp_path / "free.ply", [str(tmp_path / "teacher.ply"), str(written_capture)]
    main(["distil", *given, "--output", str(output), "--iterations", "3", "--compositor", "lc"])
    assert "Gaussians in" in capsys.readouterr().out
    main(["eval", str(output), str(written_capture), "--engine", "cpu", "--json", str(tmp_path / "found.json")])
    main(["render", str(output), str(written_capture), "--output", str(tmp_path / "views"), "--views", "held-out"])
    assert len(list((tmp_path / "views").glob("*.png"))) == 1
    before = output.read_bytes()
    for arguments in (
        ["distil", str(output), str(written_capture), "--output", str(output)],
        ["distil", *given, "--output", str(tmp_path / "free.spz")],
        ["distil", *given, "--output", str(tmp_path / "nowhere" / "free.ply")],
        ["distil", *given, "--output", str(output), "--iterations", "-1"],
        ["convert", str(output), str(tmp_path / "sorted.spz")],
    ):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 2, arguments
    assert output.read_bytes() == before


def test_without_the_capture(
    small_capture: Capture, teacher: Gaussians, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Renderings from the result folder's cameras take the photographs' place."""
    scene = tmp_path / "scene.ply"
    teacher.save(scene)
    with pytest.raises(SystemExit) as left:
        main(["distil", str(scene), "--output", str(tmp_path / "free.ply")])
    assert left.value.code == 2, "there are no cameras"
    camera, image = replace(small_capture.train[0].camera, width=60000), np.zeros((72, 60000, 3), np.uint8)
    write_cameras(tmp_path / "cameras.json", [Frame("wide", camera, image)], refined=False)
    with memory_bound(10), pytest.raises(PocketGSError, match="renderings of it would take 13 MB"):
        rendered_capture(scene, teacher, create_engine(CPU), None)
    write_cameras(tmp_path / "cameras.json", small_capture.train, refined=False)
    with pytest.raises(SystemExit) as left:
        main(["distil", str(scene), "--output", str(tmp_path / "free.ply"), "--max-memory", "5"])
    assert left.value.code == 2
    assert "distilling would take" in capsys.readouterr().err
    shown = []
    for iterations in ("0", "40"):
        output = tmp_path / f"free{iterations}.ply"
        main(["distil", str(scene), "--output", str(output), "--iterations", iterations])
        shown.append(SortFreeDrawing(read_sort_free(output)))
    errors = np.zeros(2)
    for frame in small_capture.train:
        wanted = render(teacher, frame.camera, engine=CPU).image
        errors += [np.abs(drawing.render(frame.camera).image - wanted).mean() for drawing in shown]
    assert errors[1] < 0.9 * errors[0]


def test_gradient_of_the_loss_of_depth(camera: Camera, make_gaussians: Callable[..., Gaussians]) -> None:
    """By finite differences, where both images are solid; elsewhere, and behind masks, depths do not count."""
    scene = make_gaussians(count=30, size=0.5)
    image = SortFreeRenderer("cpu").forward(sort_free(scene, "mobile", 4.0), camera, depth=True)
    seen = Rasterizer("cpu").forward(scene, camera, ("alpha", "depth"))
    assert image.depth is not None
    assert seen.alpha is not None
    assert seen.depth is not None
    counts = np.ones(image.alpha.shape, bool)
    counts[:, :5] = False
    solid = counts & (seen.alpha > 0.5) & (image.alpha > 0.5)
    assert 100 < solid.sum() < counts.sum()
    wanted = seen.depth.astype(np.float64)

    def loss(depth: np.ndarray) -> float:
        differences = np.log(depth[solid] / wanted[solid])
        return float(np.mean(differences**2) - 0.5 * np.mean(differences) ** 2)

    gradient = _d_log_depth(image, seen, counts)
    assert not gradient[~solid].any()
    depth = image.depth.astype(np.float64)
    for place in np.argwhere(solid)[::15]:
        step = np.zeros_like(depth)
        step[tuple(place)] = 1e-4
        numerical = (loss(depth + step) - loss(depth - step)) / 2e-4
        assert gradient[tuple(place)] == pytest.approx(numerical, rel=1e-3, abs=1e-7)


def test_the_loss_of_depth_brings_depths_closer(camera: Camera, make_gaussians: Callable[..., Gaussians]) -> None:
    scene = make_gaussians(count=30, size=0.5)
    photograph = np.round(np.clip(render(scene, camera, engine=CPU).image, 0, 1) * 255).astype(np.uint8)
    capture = Capture("one", Path("one"), "renderings", [Frame("0", camera, photograph)], [])
    seen = Rasterizer("cpu").forward(scene, camera, ("alpha", "depth"))
    assert seen.alpha is not None
    assert seen.depth is not None

    def spread(weight: float) -> float:
        """Standard deviation of the differences of logarithms of depth after training with a weight."""
        options = DistilOptions("mobile", iterations=60, teacher_weight=0.0, depth_weight=weight, engine="cpu")
        image = SortFreeRenderer("cpu").forward(distil(scene, capture, options).scene, camera, depth=True)
        assert image.depth is not None
        solid = (seen.alpha > 0.5) & (image.alpha > 0.5)
        return float(np.std(np.log(image.depth[solid] / seen.depth[solid])))

    assert spread(3.0) < 0.8 * spread(0.0)


def test_mistakes_are_named(small_capture: Capture, teacher: Gaussians) -> None:
    with pytest.raises(PocketGSError, match="no training view"):
        distil(teacher, replace(small_capture, train=[]))
    away = teacher.select(np.arange(20))
    away.means[:] = np.nan
    with pytest.raises(PocketGSError, match=r"no training view shows the scene"):
        distil(away, small_capture)
