"""Transients: objects that move between photographs are found and masked in the loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from mistakes import HELD_OUT, PASSES_EVERY, write_mistake
from pocketgs.capture import Capture, open_capture
from pocketgs.capture.capture import Frame
from pocketgs.metrics.evaluation import psnr
from pocketgs.prior.prior import PreparedCapture
from pocketgs.results.checkpoint import CHECKPOINT, read_checkpoint, write_checkpoint
from pocketgs.results.folder import TRANSIENTS, write_transients
from pocketgs.scene.gaussians import PARAMETERS
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rendering import render_frame
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training import transients
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.effort import sized
from pocketgs.training.preparation import prepare
from pocketgs.training.progress import Progress
from pocketgs.training.result import Checkpoint, TrainingResult
from pocketgs.training.train import train
from pocketgs.training.transients import Transients, pixels_of, transient_cells
from pocketgs.training.view_residuals import ComparedView

OPTIONS = TrainingOptions(iterations=200, max_gaussians=15_000, engine="cpu", evaluate_every=0, bundle=False)


def prepared(folder: Path, mistake: str) -> PreparedCapture:
    write_mistake(mistake, folder / mistake, 240, 180, 20)
    capture = open_capture(folder / mistake)
    sizes = [(frame.camera.width, frame.camera.height) for frame in capture.train]
    return prepare(capture, sized(OPTIONS, sizes), Stopwatch())


@pytest.fixture(scope="module")
def empty_room(tmp_path_factory: pytest.TempPathFactory) -> PreparedCapture:
    return prepared(tmp_path_factory.mktemp("room"), "none")


@pytest.fixture(scope="module")
def passed_room(tmp_path_factory: pytest.TempPathFactory) -> PreparedCapture:
    return prepared(tmp_path_factory.mktemp("room"), "passer-by")


@dataclass(frozen=True)
class Run:
    """A run, and its engine, to render from only."""

    result: TrainingResult
    engine: CpuEngine


def run_on(capture: PreparedCapture, which: Literal["mask", "keep"] = "mask") -> Run:
    engine = CpuEngine()
    return Run(train(capture, OPTIONS, opened_engine=engine, transients=which), engine)


@pytest.fixture(scope="module")
def empty_run(empty_room: PreparedCapture) -> Run:
    return run_on(empty_room)


@pytest.fixture(scope="module")
def passed_run(passed_room: PreparedCapture) -> Run:
    return run_on(passed_room)


@pytest.fixture(scope="module")
def kept_run(empty_room: PreparedCapture) -> Run:
    """On the empty room, without looking for what moves."""
    return run_on(empty_room, "keep")


@pytest.fixture(scope="module")
def trained(kept_run: Run) -> CpuEngine:
    """An engine that has been trained on the empty room."""
    return kept_run.engine


def covered(frame: Frame, empty: PreparedCapture) -> np.ndarray:
    """(H, W) bool: where a photograph differs from that of the empty room."""
    other = next(each for each in empty.frames if each.name == frame.name)
    difference = np.abs(frame.image.astype(int) - other.image).mean(axis=2)
    return np.asarray(difference > 20)


def test_a_passer_by_is_left_out_and_nothing_else(
    empty_room: PreparedCapture, passed_room: PreparedCapture, passed_run: Run
) -> None:
    found = passed_run.result.checkpoint.transients
    assert found is not None
    named = {int(Path(frame.name).stem) for frame, cells in zip(passed_room.train, found, strict=True) if cells.any()}
    there = set(range(1, 20, PASSES_EVERY)) - set(HELD_OUT)
    assert named <= there
    assert len(named) >= len(there) - 1  # in one of them only a leg is seen
    for frame, cells in zip(passed_room.train, found, strict=True):
        if cells.any():
            left_out, person = pixels_of(cells, frame), covered(frame, empty_room)
            assert (left_out & person).sum() > 0.6 * person.sum()
            assert (left_out & ~person).mean() < 0.05


def test_an_empty_room_is_trained_on_whole(empty_run: Run, kept_run: Run) -> None:
    masked, kept = empty_run.result, kept_run.result
    assert masked.checkpoint.transients is not None
    assert not any(cells.any() for cells in masked.checkpoint.transients)
    assert kept.checkpoint.transients is None
    for name in PARAMETERS:
        np.testing.assert_array_equal(getattr(masked.scene, name), getattr(kept.scene, name))


def test_the_room_appears_behind_a_passer_by(empty_room: PreparedCapture, passed_room: PreparedCapture) -> None:
    """Where a photograph shows the person, other photographs show the room. Unmasked, 23.3 dB are reached there."""
    engine = CpuEngine()
    train(passed_room, replace(OPTIONS, iterations=500), opened_engine=engine)
    truth, errors = {frame.name: frame.image / 255.0 for frame in empty_room.frames}, []
    for frame in passed_room.train:
        person = covered(frame, empty_room)
        if person.any():
            seen = np.clip(render_frame(engine, frame, passed_room.background), 0, 1)
            errors.append(np.mean((seen - truth[frame.name])[person] ** 2))
    assert -10 * np.log10(np.mean(errors)) > 24.5


def test_shadows_and_exposure_are_not_transients(empty_room: PreparedCapture, trained: CpuEngine) -> None:
    """Half of one photograph is in shadow, and another is overexposed."""
    frames = list(empty_room.train)
    shaded, bright = frames[5].image.copy(), frames[9].image.copy()
    shaded[:, :120] = shaded[:, :120] * 0.6
    bright = np.minimum(bright * 1.3, 255).astype(np.uint8)
    frames[5], frames[9] = replace(frames[5], image=shaded), replace(frames[9], image=bright)
    assert not any(cells.any() for cells in transient_cells(trained, frames, empty_room.background))


def of_another_place(frame: Frame) -> Frame:
    return replace(frame, image=np.ascontiguousarray(frame.image[::-1, ::-1]))


def test_a_photograph_of_another_place_is_left_out_whole(empty_room: PreparedCapture, trained: CpuEngine) -> None:
    frames = list(empty_room.train)
    frames[7] = of_another_place(frames[7])
    found = transient_cells(trained, frames, empty_room.background)
    assert [cells.all() for cells in found] == [number == 7 for number in range(len(frames))]


def test_nothing_is_left_out_where_many_photographs_disagree(empty_room: PreparedCapture, trained: CpuEngine) -> None:
    frames = [of_another_place(frame) if number % 3 == 0 else frame for number, frame in enumerate(empty_room.train)]
    assert not any(cells.all() for cells in transient_cells(trained, frames, empty_room.background))


def test_a_wrong_pose_that_the_prior_missed_is_left_out(empty_room: PreparedCapture) -> None:
    frames = list(empty_room.train)
    pose = frames[7].camera.world_to_camera.copy()
    pose[:3] = Rotation.from_rotvec([0.0, 0.1, 0.0]).as_matrix() @ pose[:3]
    frames[7] = replace(frames[7], camera=replace(frames[7].camera, world_to_camera=pose))
    wrong = replace(empty_room, train=frames)
    questioned, trusted = (train(wrong, OPTIONS, transients=which) for which in ("mask", "keep"))
    assert questioned.left_out == (frames[7].name,)
    assert trusted.left_out == ()
    psnrs = []
    for result in (questioned, trusted):
        engine = CpuEngine()
        engine.upload(result.scene)
        views = [(render_frame(engine, frame, wrong.background), frame.image / 255.0) for frame in wrong.held_out]
        psnrs.append(np.mean([psnr(*view) for view in views]))
    assert psnrs[0] > psnrs[1]


def cells_of(monkeypatch: pytest.MonkeyPatch, *residuals: np.ndarray, expected: float = 0.01) -> list[np.ndarray]:
    """The transient cells of views with these residuals, where their neighbours have the expected ones."""
    views = [ComparedView(each, np.full(each.shape, expected)) for each in residuals]
    monkeypatch.setattr(transients, "compare_views", lambda *_: views)
    engine: Any = None
    return transient_cells(engine, [], (0.0, 0.0, 0.0))


def with_region(residual: float, rows: int, columns: int, around: float = 0.01) -> np.ndarray:
    """(60, 80) residuals with a region at a corner."""
    residuals = np.full((60, 80), around)
    residuals[:rows, :columns] = residual
    return residuals


def test_what_covers_most_of_a_photograph_is_not_masked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A region keeps its rim of one cell; the photograph is not contradicted, since most of it fits."""
    monkeypatch.setattr(transients, "_is_contradicted", lambda view: False)
    less, more = cells_of(monkeypatch, with_region(0.5, 58, 39), with_region(0.5, 58, 41))
    assert less.sum() == 59 * 40
    assert less.mean() <= transients.MAX_SHARE < 59 * 42 / (60 * 80)
    assert not more.any()


@pytest.mark.parametrize(("wrong", "are_left_out"), [(0, True), (1, True), (2, True), (3, False), (8, False)])
def test_at_most_a_quarter_of_the_photographs_is_left_out(
    monkeypatch: pytest.MonkeyPatch, wrong: int, are_left_out: bool
) -> None:
    fits, differs = np.full((60, 80), 0.01), np.full((60, 80), 0.3)
    found = cells_of(monkeypatch, *[differs] * wrong, *[fits] * (8 - wrong))
    assert [cells.all() for cells in found] == [are_left_out] * wrong + [False] * (8 - wrong)
    assert not any(cells.any() for cells in found[wrong:])


def test_small_residuals_are_not_transients_however_well_the_neighbours_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither of a whole photograph, nor of a region, nor of the surroundings of one."""
    whole, *_ = cells_of(monkeypatch, np.full((60, 80), 0.035), *[np.full((60, 80), 0.002)] * 7, expected=0.002)
    assert not whole.any()
    (faint,) = cells_of(monkeypatch, with_region(0.07, 20, 20, around=0.002), expected=0.002)
    assert not faint.any()
    inside = with_region(0.035, 30, 30, around=0.002)
    inside[:20, :20] = 0.2
    (cells,) = cells_of(monkeypatch, inside, expected=0.002)
    assert cells[:21, :21].all()
    assert cells.sum() == 21 * 21


def test_masks_of_the_neighbours_do_not_speak_against_a_photograph(
    empty_room: PreparedCapture, trained: CpuEngine
) -> None:
    """Masked pixels are not perfectly rendered ones."""
    mask = np.zeros((180, 240), np.bool_)
    mask[120:] = True
    frames = [frame if i == 7 else replace(frame, mask=mask) for i, frame in enumerate(empty_room.train)]
    with np.errstate(all="raise"):
        found = transient_cells(trained, frames, empty_room.background)
    assert not any(cells.any() for cells in found)


def test_no_step_is_spent_on_what_is_left_out(small_capture: Capture) -> None:
    cells = [np.full((6, 8), number == 3) for number in range(len(small_capture.train))]
    found = Transients(small_capture.train, (0.0, 0.0, 0.0), cells)
    assert found.used([1, 2, 3, 4]) == [1, 2, 4]
    assert Transients(small_capture.train, (0.0, 0.0, 0.0), None).used([1, 2, 3]) == [1, 2, 3]


def test_a_photograph_that_fits_after_all_is_readmitted(empty_room: PreparedCapture, trained: CpuEngine) -> None:
    views = empty_room.train
    whole = [np.full((45, 60), number == 7) for number in range(len(views))]
    found = Transients(views, empty_room.background, whole)
    found.start(trained)
    assert found.left_out == (views[7].name,)
    found.after_step(150, trained, range(len(views)))
    assert found.left_out == ()


def test_a_resumed_run_leaves_out_the_same(
    passed_room: PreparedCapture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transients, "FIRST_LOOK", 30)
    options = replace(OPTIONS, iterations=80)
    kept: list[Checkpoint] = []

    def observer(progress: Progress) -> None:
        if progress.iteration == 50:
            kept.append(progress.checkpoint())

    whole = train(passed_room, options, observer=observer)
    write_checkpoint(tmp_path / CHECKPOINT, kept[0], {})
    resumed = train(passed_room, options, resume=read_checkpoint(tmp_path, {}))
    assert whole.checkpoint.transients is not None
    assert resumed.checkpoint.transients is not None
    assert any(cells.any() for cells in whole.checkpoint.transients)
    for cells, again in zip(whole.checkpoint.transients, resumed.checkpoint.transients, strict=True):
        np.testing.assert_array_equal(cells, again)
    for name in PARAMETERS:
        np.testing.assert_array_equal(getattr(whole.scene, name), getattr(resumed.scene, name))


class Asked:
    """An engine that records the masks it is given."""

    def __init__(self) -> None:
        self.masks: list[Sequence[np.ndarray | None]] = []

    def set_masks(self, masks: Sequence[np.ndarray | None]) -> None:
        self.masks.append(masks)


def test_looks_are_at_doubled_iterations_after_two_rounds(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transients, "transient_cells", lambda *_: [np.ones((3, 4), np.bool_)] * len(frames))
    frames = small_capture.train * 20
    found, engine = Transients(frames, (0.0, 0.0, 0.0), None), Asked()
    looks = []
    for iteration in range(1, 2000):
        before = len(engine.masks)
        found.after_step(iteration, engine, range(len(frames)))  # type: ignore[arg-type]
        if len(engine.masks) > before:
            looks.append(iteration)
    assert looks == [280, 560, 1120]


def test_the_search_ends_where_nothing_moves(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []
    monkeypatch.setattr(transients, "transient_cells", lambda *_: looks.append(1) or [np.zeros((3, 4), np.bool_)] * 7)
    found, engine = Transients(small_capture.train, (0.0, 0.0, 0.0), None), Asked()
    for iteration in range(1, 2000):
        found.after_step(iteration, engine, range(7))  # type: ignore[arg-type]
    assert len(looks) == 1
    assert not engine.masks


def test_views_that_are_held_back_are_not_judged(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    judged: list[Sequence[Frame]] = []

    def everything(_: object, frames: Sequence[Frame], __: object) -> list[np.ndarray]:
        judged.append(frames)
        return [np.ones((18, 24), np.bool_) for _ in frames]

    monkeypatch.setattr(transients, "transient_cells", everything)
    found, engine = Transients(small_capture.train, (0.0, 0.0, 0.0), None), Asked()
    found.after_step(150, engine, [0, 2])  # type: ignore[arg-type]
    assert judged == [[small_capture.train[0], small_capture.train[2]]]
    assert [mask is not None for mask in engine.masks[0]] == [True, False, True, False, False, False, False]


def test_pictures_show_what_was_left_out(small_capture: Capture, tmp_path: Path) -> None:
    cells = [np.zeros((6, 8), np.bool_) for _ in small_capture.train]
    cells[2][:, :4] = True
    masked = [replace(frame, mask=np.zeros((72, 96), np.bool_)) for frame in small_capture.train]
    write_transients(tmp_path, masked, cells)
    [path] = (tmp_path / TRANSIENTS).iterdir()
    picture, photograph = np.asarray(Image.open(path)), small_capture.train[2].image
    assert (picture[:, :48, 0] >= 170).all()
    assert (picture[:, :48, 1:] <= 85).all()
    np.testing.assert_array_equal(picture[:, 48:], photograph[:, 48:])


@pytest.mark.parametrize("iterations", [14, 15])
def test_no_search_follows_the_last_step(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch, iterations: int
) -> None:
    """What it would find comes too late to be left out, and takes time."""
    monkeypatch.setattr(transients, "FIRST_LOOK", 14)
    found = train(small_capture, iterations=iterations, prior="none", engine="cpu", evaluate_every=0)
    assert (found.checkpoint.transients is None) == (iterations == 14)


def test_what_a_mask_excludes_does_not_speak_against_its_photograph(
    empty_room: PreparedCapture, trained: CpuEngine
) -> None:
    """Such as somebody whom the user has masked, close to the camera."""
    frames, mask = list(empty_room.train), np.ones((180, 240), np.bool_)
    mask[:120] = False
    image = np.where(mask[..., None], frames[7].image, 255 - frames[7].image)
    frames[7] = replace(frames[7], image=image, mask=mask)
    assert not any(cells.any() for cells in transient_cells(trained, frames, empty_room.background))
