"""Plans: sizes that fit are used, others are refused, and a larger budget never gives less."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pocketgs.capture import ListedCapture, list_capture
from pocketgs.capture.capture import Frame
from pocketgs.capture.decoding.image_file import ImageHeader
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.loading import LensHandling, Preparation
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.room import need_of
from pocketgs.prior.depth.stereo import StereoExtent, StereoNeed
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import EngineOptions
from pocketgs.system.device import MemoryNeed
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.calibration import Speed, measure_speed
from pocketgs.training.planning.effort import sized
from pocketgs.training.planning.machine import SWEEP_KERNELS, Machine, this_machine
from pocketgs.training.planning.plan import MIN_GAUSSIANS, MIN_SIDE, Plan, make_plan, shrinking_warning
from pocketgs.training.planning.time_model import timetable
from pocketgs.training.planning.work import Work

MACHINE = Machine(
    threads=2,
    cores=2,
    resident=160_000_000,
    compiles=False,
    memory_needed=CpuEngine(1).memory_needed,
    stereo_needed=CpuStereo().memory_needed,
)


class Photographs(ListedCapture):
    """A capture of given sizes, without files."""

    @cached_property
    def _headers(self) -> dict[str, ImageHeader]:  # type: ignore[override]
        return {
            source.name: ImageHeader(source.camera.width, source.camera.height, has_alpha=False)
            for source in self.listing.frames
        }


def photographs(width: int = 504, height: int = 378, count: int = 20, **changes: Any) -> ListedCapture:
    camera = Camera(width, height, width, width, width / 2, height / 2, np.eye(4))
    frames = [FrameSource(str(index), Path(f"{index}.png"), camera) for index in range(count)]
    held_out = frozenset(frame.name for frame in frames[::8]) if count > 1 else frozenset()
    listed = Photographs("many", Path("many"), Listing("made up", frames), held_out, "", Preparation())
    return replace(listed, **changes)


CAPTURES = st.builds(photographs, st.integers(20, 4000), st.integers(20, 4000), st.integers(1, 200))
OPTIONS = st.builds(
    SizedOptions,
    prior=st.sampled_from(["dense", "sparse", "none"]),
    max_gaussians=st.integers(4, 400_000),
    sh_degree=st.integers(0, 3),
    iterations=st.integers(1, 5000),
)
SPEEDS = st.builds(Speed, st.floats(0.1, 20), st.floats(0.1, 20), st.floats(0.1, 20))


def planned(listed: ListedCapture, options: SizedOptions, machine: Machine = MACHINE) -> Plan | None:
    try:
        return make_plan(listed, options, machine)
    except PocketGSError:
        return None


def assert_no_less(larger: Plan | None, smaller: Plan | None) -> None:
    if smaller is not None:
        assert larger is not None
        assert (larger.shrink, -larger.gaussians) <= (smaller.shrink, -smaller.gaussians)


@given(CAPTURES, OPTIONS, st.integers(1, 20_000), st.integers(0, 20_000))
def test_more_memory_never_gives_less(listed: ListedCapture, options: SizedOptions, memory: int, more: int) -> None:
    smaller, larger = (planned(listed, replace(options, max_memory=size)) for size in (memory, memory + more))
    assert_no_less(larger, smaller)
    if smaller:
        assert max(smaller.peak_rss_mb, smaller.device_mb) <= memory


@given(CAPTURES, OPTIONS, SPEEDS, st.floats(0.01, 2000), st.floats(0, 2000))
def test_more_time_never_gives_less(
    listed: ListedCapture, options: SizedOptions, speed: Speed, seconds: float, more: float
) -> None:
    machine = replace(MACHINE, speed=speed, elapsed=1.5)
    options = replace(options, max_memory=100_000)
    smaller, larger = (
        planned(listed, replace(options, time_budget=budget), machine) for budget in (seconds, seconds + more)
    )
    assert_no_less(larger, smaller)
    if smaller:
        assert smaller.seconds is not None
        assert smaller.seconds <= seconds + 1e-6
        assert 1 <= smaller.iterations <= options.iterations


@given(CAPTURES, OPTIONS, st.integers(1, 5000))
def test_a_refusal_names_a_budget_that_will_do(listed: ListedCapture, options: SizedOptions, memory: int) -> None:
    if planned(listed, replace(options, max_memory=memory)):
        return
    with pytest.raises(PocketGSError, match="expected --max-memory") as refusal:
        make_plan(listed, replace(options, max_memory=memory), MACHINE)
    enough = int(str(refusal.value).split("--max-memory ")[1].split()[0])
    assert enough > memory
    assert planned(listed, replace(options, max_memory=enough))


def test_a_refusal_of_time_names_a_budget_that_will_do() -> None:
    machine = replace(MACHINE, speed=Speed(1.0, 1.0, 1.0), elapsed=2.0)
    with pytest.raises(PocketGSError, match="time budget: found 3 s") as refusal:
        make_plan(photographs(), SizedOptions(time_budget=3.0), machine)
    enough = float(str(refusal.value).split("--time-budget ")[1].split()[0])
    plan = make_plan(photographs(), SizedOptions(time_budget=enough), machine)
    assert 50 <= plan.iterations < 500


@pytest.mark.parametrize("seconds", [15.0, 20.0, 30.0, 40.0, 60.0, 90.0, 130.0, 200.0, 400.0])
@pytest.mark.parametrize("asked", [{}, {"effort": "quick"}, {"effort": "best"}, {"recipe": "3dgs-7k"}], ids=str)
def test_however_many_iterations_within_a_budget_do_not_make_it_smaller(asked: dict[str, Any], seconds: float) -> None:
    """Who asks for 30,000, and to stop after five minutes, gets as many as fit, at the size that five minutes give."""
    machine, listed = replace(MACHINE, speed=Speed(1.0, 1.0, 1.0), elapsed=2.0), photographs()
    options = TrainingOptions(**asked, prior="none", time_budget=seconds)
    alone, endless = (
        make_plan(listed, sized(replace(options, iterations=iterations), listed.outline().training), machine)
        for iterations in (None, 30_000)
    )
    assert (endless.shrink, endless.gaussians) == (alone.shrink, alone.gaussians)
    assert endless.iterations >= alone.iterations


@pytest.mark.parametrize(("asked", "enough"), [({"effort": "best"}, 510), ({"recipe": "3dgs-30k"}, 1500)], ids=str)
def test_long_runs_keep_their_size_in_time_for_half_of_3000_iterations(asked: dict[str, Any], enough: int) -> None:
    """Of fewer if the capture has few photographs to visit."""
    machine, listed = replace(MACHINE, speed=Speed(1.0, 1.0, 1.0), elapsed=2.0), photographs()
    outline = listed.outline()
    asked_of_all = sized(TrainingOptions(**asked, prior="none", time_budget=1e6), outline.training)
    size = Work(outline, asked_of_all, machine.threads)
    times = timetable(size, Speed(1.0, 1.0, 1.0))
    for steps, is_kept in ((enough + 1, True), (enough - 1, False)):
        seconds = machine.elapsed + times.total(steps) + times.step / 2
        plan = make_plan(listed, replace(asked_of_all, time_budget=seconds), machine)
        assert ((plan.shrink, plan.gaussians) == (1, asked_of_all.max_gaussians)) == is_kept


def test_what_fits_is_left_as_it_is() -> None:
    plan = make_plan(photographs(), SizedOptions(), MACHINE)
    assert (plan.shrink, plan.width, plan.height, plan.gaussians, plan.iterations) == (1, 504, 378, 50_000, 500)
    assert (plan.seconds, plan.device_mb) == (None, 0.0)
    assert shrinking_warning(plan, SizedOptions()) is None


def test_fewer_gaussians_come_before_smaller_photographs() -> None:
    def sizes(memory: int) -> tuple[int, int]:
        plan = make_plan(photographs(), SizedOptions(prior="none", max_memory=memory), MACHINE)
        assert shrinking_warning(plan, SizedOptions(max_memory=memory)) is not None or (
            plan.shrink,
            plan.gaussians,
        ) == (1, 50_000)
        return plan.shrink, plan.gaussians

    order = list(dict.fromkeys(sizes(memory) for memory in range(700, 230, -1)))
    assert order[:5] == [(1, 50_000), (1, 25_000), (1, 12_500), (2, 50_000), (2, 25_000)]


def test_the_warning_says_how_many_of_the_iterations_there_is_time_for() -> None:
    machine = replace(MACHINE, speed=Speed(1.0, 1.0, 1.0))
    options = SizedOptions(prior="none", iterations=2000, usual_iterations=2000, time_budget=8.0)
    plan = make_plan(photographs(), options, machine)
    warning = shrinking_warning(plan, options)
    assert warning is not None
    assert plan.iterations < 2000
    assert warning.startswith("to keep to 3,000 MB and 8 s: ")
    assert warning.endswith(f", about {plan.iterations:,} of 2,000 iterations")
    open_ended = shrinking_warning(plan, replace(options, open_ended=True))
    assert open_ended is not None
    assert open_ended.endswith(f", about {plan.iterations:,} iterations")


def test_the_warning_says_what_was_done() -> None:
    options = SizedOptions(max_memory=1000)
    plan = make_plan(photographs(4032, 3024, 60), options, MACHINE)
    assert plan.shrink > 1
    size = f"photographs at 1/{plan.shrink} of their size, {plan.width}x{plan.height} (--downscale {plan.shrink})"
    assert shrinking_warning(plan, options) == f"to keep to 1,000 MB: {size}"


@given(st.integers(1, 1500))
def test_a_size_that_is_given_is_kept(memory: int) -> None:
    listed, options = photographs(2016, 1512, size_is_given=True), SizedOptions(max_memory=memory)
    plan = planned(listed, options)
    if plan:
        assert plan.shrink == 1
    else:
        with pytest.raises(PocketGSError, match=r"with photographs of 2016x1512 .* or a larger --downscale"):
            make_plan(listed, options, MACHINE)


@given(CAPTURES, OPTIONS, st.integers(1, 20_000))
def test_nothing_becomes_senselessly_small(listed: ListedCapture, options: SizedOptions, memory: int) -> None:
    plan = planned(listed, replace(options, max_memory=memory))
    if plan:
        assert plan.gaussians >= min(MIN_GAUSSIANS, options.max_gaussians)
        assert plan.shrink == 1 or min(plan.width, plan.height) >= MIN_SIDE


def test_a_first_run_is_refused_for_what_compiling_takes() -> None:
    compiling = replace(MACHINE, compiles=True)
    enough = int(make_plan(photographs(), SizedOptions(), MACHINE).peak_rss_mb) + 1
    first = int(make_plan(photographs(), SizedOptions(), compiling).peak_rss_mb) + 1
    assert first > enough + 300
    assert make_plan(photographs(), SizedOptions(max_memory=enough), MACHINE).shrink == 1
    assert make_plan(photographs(), SizedOptions(max_memory=first), compiling).shrink == 1
    with pytest.raises(PocketGSError, match="since kernels are compiled in the first run"):
        make_plan(photographs(), SizedOptions(max_memory=500), compiling)


def test_what_the_engine_refuses_is_made_smaller() -> None:
    def memory_needed(gaussians: int, coefficients: int, photographs: Any) -> MemoryNeed:
        if gaussians > 30_000:
            raise PocketGSError("too many")
        return MemoryNeed(0, 100_000_000)

    plan = make_plan(photographs(), SizedOptions(), replace(MACHINE, memory_needed=memory_needed))
    assert (plan.shrink, plan.gaussians, plan.device_mb) == (1, 25_000, 100.0)
    with pytest.raises(PocketGSError, match="too many"):
        make_plan(
            photographs(),
            SizedOptions(),
            replace(MACHINE, memory_needed=lambda *_: memory_needed(40_000, 1, ())),
        )


@pytest.mark.parametrize("k1", [-0.3, 0.2])
def test_outlines_know_what_undistortion_leaves(capture_folder: Path, k1: float) -> None:
    """Undistortion enlarges photographs of a barrel lens, and shrinks those of a pincushion lens."""
    path = capture_folder / "transforms.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "k1": k1}))
    for options in ({}, {"lens": "ignore"}, {"max_size": 50}):
        listed = list_capture(capture_folder, **options)
        outline, capture = listed.outline(), listed.load()
        assert outline.training == tuple((frame.camera.width, frame.camera.height) for frame in capture.train)
    assert (list_capture(capture_folder).outline().pixels > 96 * 72) == (k1 < 0)


def test_photographs_of_compensated_exposure_are_planned_for() -> None:
    listed, stages = photographs(), {}
    for exposure in ("auto", "off"):
        options = SizedOptions(max_memory=20_000, exposure=exposure, prior="sparse")
        stages[exposure] = make_plan(listed, options, MACHINE).rss_by_stage_mb
    compensated = 1.1 * listed.outline().image_bytes / 1e6
    for stage in ("points", "training"):
        assert stages["auto"][stage] - stages["off"][stage] == pytest.approx(compensated, abs=1.0)
    assert stages["auto"]["capture"] == stages["off"]["capture"]


def through_lenses(k1: float, lens: LensHandling, count: int = 20) -> ListedCapture:
    """Photographs of a lens each."""
    listed = photographs(1600, 1200, count, preparation=Preparation(lens=lens))
    frames = [
        replace(source, lens=Lens("opencv", (k1 + 1e-4 * index, 0.0, 0.0, 0.0)))
        for index, source in enumerate(listed.listing.frames)
    ]
    return replace(listed, listing=replace(listed.listing, frames=frames))


def test_copies_for_the_prior_take_memory_until_training() -> None:
    machine = replace(MACHINE, memory_needed=lambda *_: MemoryNeed(1))
    options = SizedOptions(max_memory=20_000, exposure="off", prior="sparse", max_gaussians=1000)
    direct, as_they_are = (
        make_plan(through_lenses(-0.2, lens), options, machine).rss_by_stage_mb for lens in ("direct", "ignore")
    )
    copies = through_lenses(-0.2, "direct").outline().copies
    assert copies is not None
    assert copies.image_bytes > 1.05 * 20 * 3 * 1600 * 1200
    more = {stage: direct[stage] - as_they_are[stage] for stage in direct}
    assert more["points"] == pytest.approx(1.1 * copies.image_bytes / 1e6, rel=0.01)
    assert more["poses"] > 0.8 * more["points"]
    assert more["capture"] == more["training"] == 0


def test_kernels_for_lenses_that_photographs_keep_are_planned_for() -> None:
    """Once: the engine notes which models of lenses it is compiled for."""
    compiled = replace(MACHINE, compiles_lenses=frozenset({"fisheye"}))
    compiling = replace(MACHINE, compiles_lenses=frozenset({"opencv", "fisheye"}))
    options = SizedOptions(prior="none", max_gaussians=1000)
    direct, undistorted = through_lenses(-0.2, "direct"), through_lenses(-0.2, "undistort")
    peaks = [make_plan(direct, options, machine).peak_rss_mb for machine in (MACHINE, compiled, compiling)]
    assert peaks == [peaks[0], peaks[0], pytest.approx(peaks[0] + 350)]
    undone = [make_plan(undistorted, options, machine).peak_rss_mb for machine in (MACHINE, compiling)]
    assert undone[0] == undone[1]


def test_engine_notes_the_lenses_that_it_is_compiled_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("pocketgs.system.compiled_variants.folder_of", lambda package: tmp_path / package)
    monkeypatch.setattr(CpuEngine, "_prepare_for", lambda engine, lens: None)
    engine, stereo, options = CpuEngine(1), CpuStereo(), SizedOptions()
    before = this_machine(engine, stereo, options).compiles_lenses
    assert {"opencv", "fisheye"} <= before
    camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, np.eye(4))
    for lens in (Lens(), Lens("fisheye", (0.1, 0.0, 0.0, 0.0))):
        engine.set_views([Frame("photo", replace(camera, lens=lens), np.zeros((16, 16, 3), np.uint8))])
    assert this_machine(engine, stereo, options).compiles_lenses == before - {"fisheye"}
    monkeypatch.setattr(engine, "name", "webgpu", raising=False)
    assert this_machine(engine, stereo, options).compiles_lenses == frozenset()


@pytest.mark.parametrize("lenses", [1, 3])
def test_reading_through_lenses_takes_no_more_than_planned(tmp_path: Path, lenses: int) -> None:
    """In a process of its own, since what is freed is not always given back."""
    names = [f"{number}.jpg" for number in range(4)]
    base = Image.fromarray(np.random.default_rng(0).integers(0, 256, (150, 200, 3), np.uint8))
    frames = []
    for number, name in enumerate(names):
        base.resize((3000, 2250)).save(tmp_path / name)
        pose = np.eye(4)
        pose[0, 3] = number
        k1 = -0.2 - 0.001 * (number % lenses)
        frames.append({"file_path": name, "transform_matrix": pose.tolist(), "k1": k1})
    document = {"w": 3000, "h": 2250, "fl_x": 2500.0, "camera_model": "OPENCV", "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    code = (
        "import sys; from pathlib import Path; from pocketgs.capture import list_capture\n"
        "from pocketgs.system.process import peak_rss_mb\n"
        "listed = list_capture(Path(sys.argv[1]), max_size=300); planned = listed.outline().reading_bytes / 1e6\n"
        "before = peak_rss_mb(); listed.load(readers=1); print(planned, peak_rss_mb() - before)"
    )
    found = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True).stdout
    planned, taken = map(float, found.split())
    assert 0.4 * planned < taken < planned


@given(st.integers(101, 3000), st.integers(1, 400))
def test_the_smallest_photograph_bounds_shrinking(side: int, memory: int) -> None:
    """With photographs of several sizes, none shrinks to nothing."""
    mixed = photographs(3000, 2000, 3)
    camera = Camera(side, 100, side, side, side / 2, 50.0, np.eye(4))
    small = FrameSource("small", Path("small.png"), camera)
    listed = replace(mixed, listing=replace(mixed.listing, frames=[*mixed.listing.frames, small]))
    with suppress(PocketGSError):
        plan = make_plan(listed, SizedOptions(max_memory=memory), MACHINE)
        assert plan.shrink == 1


def test_outlines_are_what_is_loaded(written_capture: Path) -> None:
    for shrink in (1, 2, 3):
        listed = list_capture(written_capture, max_size=90)
        outline, capture = listed.outline(shrink), listed.load(shrink)
        assert outline.training == tuple((frame.camera.width, frame.camera.height) for frame in capture.train)
        assert outline.held_out == tuple((frame.camera.width, frame.camera.height) for frame in capture.held_out)
        assert outline.image_bytes == capture.image_bytes
        assert outline.stored_pixels == 96 * 72


@pytest.mark.parametrize(
    ("name", "options"), [("fern", {"images": "images_8"}), ("lego", {"downscale": 8}), ("fox", {"downscale": 8})]
)
def test_outlines_of_real_captures(data_folder: Path, name: str, options: dict[str, Any]) -> None:
    listed = list_capture(data_folder / name, **options)
    outline, capture = listed.outline(2), listed.load(2)
    assert (len(outline.training), len(outline.held_out)) == (len(capture.train), len(capture.held_out))
    assert capture.image_bytes <= outline.image_bytes < 1.1 * capture.image_bytes


@pytest.mark.parametrize("bytes_of", [lambda path: b"", lambda path: path.read_bytes()[:10]])
def test_outlines_of_damaged_photographs(capture_folder: Path, bytes_of: Callable[[Path], bytes]) -> None:
    """They are left out, but one must be left to train on: the first is held out."""
    _, *others = sorted((capture_folder / "images").iterdir())
    others[2].write_bytes(bytes_of(others[2]))
    assert len(list_capture(capture_folder).outline().training) == len(others) - 1
    for photograph in others:
        photograph.write_bytes(bytes_of(photograph))
    with pytest.raises(PocketGSError, match=f"{others[0].name}: cannot be decoded"):
        list_capture(capture_folder).outline()


def test_the_cpu_engine_holds_no_more_than_it_says(written_capture: Path) -> None:
    capture = list_capture(written_capture).load()
    from pocketgs.training.train import train

    result = train(capture, iterations=30, prior="none", engine="cpu")
    sizes = [(frame.camera.width, frame.camera.height) for frame in capture.train]
    needed = CpuEngine().memory_needed(len(result.scene), result.scene.sh.shape[1], sizes)
    held = sum(result.engine_bytes.values())
    assert needed.device == 0
    assert held <= needed.process < 3 * held


@pytest.mark.usefixtures("adapter")
def test_a_gpu_holds_what_depth_takes_before_training() -> None:
    """Of large photographs and few Gaussians, that is more than training takes."""
    options = SizedOptions(engine="webgpu", max_gaussians=1000, max_memory=3000)
    needed = WebGpuStereo().memory_needed
    plain = make_plan(photographs(1008, 756), options, MACHINE)
    plan = make_plan(photographs(1008, 756), options, replace(MACHINE, stereo_needed=needed))
    assert plain.device_mb == 0
    extent = StereoExtent.of([(731, 548)], options.source_views, 17)
    assert plan.device_mb == pytest.approx(needed(extent).sweeping.device / 1e6, rel=0.01)
    assert plan.rss_by_stage_mb["depth"] > plain.rss_by_stage_mb["depth"]
    # What a GPU does not hold is swept by the CPU, and planned so.
    assert need_of(WebGpuStereo(max_memory=100), extent) == CpuStereo().memory_needed(extent)


def on_a_gpu(extent: StereoExtent) -> StereoNeed:
    return StereoNeed(MemoryNeed(0, 1_000_000), MemoryNeed(0, 1_000_000))


def test_sweeps_in_place_of_a_gpu_are_planned_as_the_cpus() -> None:
    """In time, and in memory for their kernels; a GPU that has room needs neither."""
    options = SizedOptions(engine="webgpu", max_gaussians=1000, time_budget=1000.0)
    fast = replace(MACHINE, speed=Speed(1.0, 0.01, 1.0), compiles_sweeps=True)
    full, roomy = (
        make_plan(photographs(), options, replace(fast, stereo_needed=need))
        for need in (MACHINE.stereo_needed, on_a_gpu)
    )
    slow, compiled = replace(fast, speed=Speed(1.0, 1.0, 1.0)), replace(fast, compiles_sweeps=False)
    assert full.seconds == make_plan(photographs(), options, slow).seconds
    assert full.seconds is not None
    assert roomy.seconds is not None
    assert roomy.seconds < full.seconds
    assert full.peak_rss_mb == pytest.approx(make_plan(photographs(), options, compiled).peak_rss_mb + 350)
    without = replace(compiled, stereo_needed=on_a_gpu)
    assert roomy.peak_rss_mb == make_plan(photographs(), options, without).peak_rss_mb


@pytest.mark.parametrize("cores", [1, 2, 8, 64])
@pytest.mark.parametrize("size", [(1600, 1200), (4032, 3024), (6000, 4000), (8064, 6048)])
def test_more_cores_take_no_more_than_there_is(size: tuple[int, int], cores: int) -> None:
    """Phones store up to 48 megapixels. However many cores could read them at once, the scene is the same."""
    listed = photographs(*size, count=100, preparation=Preparation(max_size=800))
    machine = replace(MACHINE, threads=cores, cores=cores, memory_needed=CpuEngine(cores).memory_needed)
    plan = make_plan(listed, SizedOptions(max_gaussians=150_000), machine)
    assert (plan.shrink, plan.gaussians) == (1, 150_000)
    assert 1 <= plan.readers <= cores
    assert plan.peak_rss_mb <= 3000


def test_many_photographs_take_memory_for_their_features() -> None:
    """Each has up to 2,000, with 128 numbers each; all together have 2 million."""
    counts, held = (20, 500, 1000, 3000), []
    for count in counts:
        listed = photographs(160, 120, count)
        plan = make_plan(listed, SizedOptions(max_memory=100_000), MACHINE)
        held.append(plan.rss_by_stage_mb["poses"] - 1.1e-6 * listed.outline().image_bytes)
    few, some, many, more = held
    descriptors = 4e-6 * 128 * 2000
    assert some - few > descriptors * (500 - 20)
    assert many - some > descriptors * (1000 - 500)
    assert more - many < 10
    options = SizedOptions(max_memory=100_000, prior="none")
    assert "poses" not in make_plan(photographs(160, 120, 1000), options, MACHINE).rss_by_stage_mb


def test_many_photographs_take_time_for_equations_of_all_of_them() -> None:
    machine, options = replace(MACHINE, speed=Speed(1.0, 1.0, 1.0)), SizedOptions(max_memory=100_000, time_budget=1e5)

    def refining(count: int) -> float:
        with_it, without = (
            make_plan(photographs(160, 120, count), replace(options, bundle=bundle), machine).seconds
            for bundle in (True, False)
        )
        assert with_it is not None
        assert without is not None
        return with_it - without

    assert refining(100) == pytest.approx(10 * refining(10), rel=0.02)
    assert refining(1000) > 15 * refining(100)


def test_silhouettes_of_all_photographs_take_time() -> None:
    outlines = (photographs(400, 400, count).outline() for count in (100, 200))
    of_some, of_more = (
        [
            timetable(Work(replace(outline, has_alpha=alpha), SizedOptions(), 2), Speed(1.0, 1.0, 1.0)).before
            for alpha in (False, True)
        ]
        for outline in outlines
    )
    some, more = (silhouettes - none for none, silhouettes in (of_some, of_more))
    assert some > 5
    assert more == pytest.approx(2 * some, rel=0.02)


def test_little_memory_reads_one_photograph_after_the_other() -> None:
    listed = photographs(8064, 6048, count=100, preparation=Preparation(max_size=400))
    machine = replace(MACHINE, cores=8)
    assert make_plan(listed, SizedOptions(max_memory=1800), machine).readers == 1
    assert make_plan(listed, SizedOptions(max_memory=6000), machine).readers > 1


@pytest.mark.parametrize(("budget", "compiles"), [(None, False), (60.0, True)])
def test_calibration_beside_a_gpu_compiles_the_cpus_sweeps(
    monkeypatch: pytest.MonkeyPatch, budget: float | None, compiles: bool
) -> None:
    monkeypatch.setattr("pocketgs.training.planning.machine.is_compiled", lambda package: package != SWEEP_KERNELS)
    engine, stereo = CpuEngine(1), CpuStereo()
    monkeypatch.setattr(engine, "name", "webgpu", raising=False)
    machine = this_machine(engine, stereo, SizedOptions(engine="webgpu", time_budget=budget))
    assert (machine.compiles, machine.compiles_sweeps) == (compiles, True)


@pytest.mark.usefixtures("adapter")
def test_speed_beside_a_gpu_without_room_is_the_cpus() -> None:
    speed = measure_speed(create_engine(EngineOptions(engine="cpu")), WebGpuStereo(max_memory=20), 1, with_prior=True)
    assert speed.sweeps == speed.prior


def test_speed_is_measured_on_any_engine() -> None:
    options = SizedOptions(engine="cpu")
    engine = create_engine(EngineOptions(engine="cpu"))
    stereo = CpuStereo()
    machine = this_machine(engine, stereo, options)
    assert machine.resident > 50_000_000
    speed = measure_speed(engine, stereo, 1, with_prior=True)
    assert speed.prior > 0
    assert speed.sweeps == speed.prior
    assert speed.training > 0
    without = measure_speed(engine, stereo, 1, with_prior=False)
    assert without.prior == without.training


def test_time_is_left_to_compare_the_held_out_photographs() -> None:
    """Each takes some seconds, and more if it is larger: without them, a run would end after its time."""
    machine = replace(MACHINE, speed=Speed(1.0, 1.0, 1.0))
    options = SizedOptions(prior="none", time_budget=1000.0, max_memory=100_000)
    listings = [photographs(side, side, 24) for side in (500, 1000)]
    without = [replace(listed, held_out_names=frozenset()) for listed in listings]
    reserves = [make_plan(listed, options, machine).reserve or 0.0 for listed in (*listings, *without)]
    small, large, *none = reserves
    assert none[0] == none[1] < small < large
    assert large - none[1] == pytest.approx(4 * (small - none[0]), rel=0.2)
    assert large - none[1] > 3 * 1.0  # three of a megapixel
