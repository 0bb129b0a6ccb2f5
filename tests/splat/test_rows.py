"""Changes of rows against NumPy, and the statistics of engines for strategies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs import Camera, Gaussians, PocketGSError, Rasterizer
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.gaussians import PARAMETERS
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.colours import transforms_of
from pocketgs.splat.cpu.adam import regularise
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import CLUSTER, SceneArrays
from pocketgs.splat.cpu.noise import add_noise
from pocketgs.splat.engine import EngineOptions, OptimiserState
from pocketgs.splat.parameters import COEFFICIENTS, GROUPS, Group, ParameterLayout, first_column
from pocketgs.splat.reference.loss import photometric_loss
from pocketgs.splat.reference.project import project
from pocketgs.splat.reference.rasterize import rasterize, rasterize_backward
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.rows import RowChange
from pocketgs.splat.settings import ColourSettings, LearningRates, LossSettings, PositionNoise, StepSettings
from pocketgs.splat.store import ParameterStore
from splat.training_step import assert_identical, camera_in_front, photograph

MakeGaussians = Callable[..., Gaussians]
RATES = LearningRates(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
STEP = StepSettings(LearningRates(1e-3, 5e-3, 4e-3, 1e-2, 1e-2, 1e-3), LossSettings("l2"), statistics=True)


def test_columns_are_those_of_the_optimiser() -> None:
    for coefficients in (1, 4, 9, 16):
        layout = ParameterLayout(coefficients)
        assert (layout.columns, layout.numbers) == (10 + 3 * coefficients, 11 + 3 * coefficients)
        expected = np.repeat([1, 2, 3, 4, 5, 6], [3, 3, 3, 1, 3, 3 * (coefficients - 1)])
        np.testing.assert_array_equal(layout.rates_by_column(RATES), expected)
        assert [first_column(group.name) for group in GROUPS] == [
            layout.columns_of(group.name).start for group in GROUPS
        ]
    assert tuple(group.name for group in GROUPS) == PARAMETERS


def test_a_parameter_can_be_added() -> None:
    features = Group("features", (2, COEFFICIENTS), (("means", None),))
    layout = ParameterLayout(4, (*GROUPS, features))
    assert layout.columns_of("features") == slice(22, 30)
    assert layout.numbers == 31
    np.testing.assert_array_equal(layout.rates_by_column(RATES)[20:], [6, 6, *[1] * 8])


def numbered(count: int, coefficients: int = 4) -> tuple[Gaussians, OptimiserState]:
    """A scene and moments with unique numbers."""
    rng = np.random.default_rng(count)
    scene = Gaussians(
        rng.normal(size=(count, 3)),
        rng.normal(size=(count, 3)),
        rng.normal(size=(count, 4)),
        rng.normal(size=count),
        rng.normal(size=(count, coefficients, 3)),
    )
    scene.quaternions = scene.unit_quaternions
    moments = rng.normal(size=(2, count, ParameterLayout(coefficients).columns)).astype(np.float32)
    return scene, OptimiserState(moments[0], moments[1], 5)


@settings(max_examples=60)
@given(st.data())
def test_rows_change_as_in_numpy(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 12))
    scene, state = numbered(count)
    store = ParameterStore(scene, state)
    expected = {name: getattr(scene, name).copy() for name in PARAMETERS}
    moments = [state.first_moments.copy(), state.second_moments.copy()]
    for _ in range(data.draw(st.integers(1, 3))):
        rows = store.count
        sources = np.array(data.draw(st.lists(st.integers(0, rows - 1), min_size=1, max_size=40)), np.int32)
        fresh = np.array(data.draw(st.lists(st.booleans(), min_size=len(sources), max_size=len(sources))))
        name = data.draw(st.sampled_from(PARAMETERS))
        given_rows = np.array(data.draw(st.lists(st.integers(0, len(sources) - 1), unique=True)), np.int32)
        values = np.full((len(given_rows), *expected[name].shape[1:]), 0.5, np.float32)  # quaternions of unit length
        store.change_rows(RowChange(sources, fresh, {name: (given_rows, values)}))
        expected = {key: array[sources] for key, array in expected.items()}
        expected[name][given_rows] = values
        moments = [array[sources] for array in moments]
        for array in moments:
            array[fresh] = 0.0
            array[given_rows, ParameterLayout(4).columns_of(name)] = 0.0
        assert store.count == len(sources) <= store.capacity
        assert_identical(store.scene, Gaussians(*expected.values()))
        assert store.first_moments.tobytes() == moments[0].tobytes()
        assert store.second_moments.tobytes() == moments[1].tobytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (RowChange(np.array([0, 3], np.int32), np.zeros(2, bool)), "sources name rows 0 to 3, expected 0 to 2 of 3"),
        (RowChange(np.array([-1], np.int32), np.zeros(1, bool)), "sources name rows -1 to -1"),
        (RowChange(np.array([0]), np.zeros(1, bool)), r"sources are int64 \(1,\), expected int32"),
        (RowChange(np.array([0], np.int32), np.zeros(2, bool)), r"fresh is bool \(2,\), expected bool \(1,\)"),
        (RowChange.of_values(3, {"colours": (np.array([0]), np.zeros(1))}), "'colours', which is not a parameter"),
        (
            RowChange.of_values(3, {"means": (np.array([0]), np.zeros(3))}),
            r"float64 \(3,\), expected numbers \(1, 3\)",
        ),
        (
            RowChange.of_values(3, {"means": (np.array([0]), np.full((1, 3), "1"))}),
            r"<U1 \(1, 3\), expected numbers",
        ),
        (
            RowChange.of_values(3, {"means": (np.array([0.0]), np.zeros((1, 3)))}),
            r"rows float64 \(1,\), expected",
        ),
        (RowChange.of_values(3, {"means": (np.array([0, 0]), np.zeros((2, 3)))}), "means names a row twice"),
        (RowChange.of_values(3, {"means": (np.array([3]), np.zeros((1, 3)))}), "means name rows 3 to 3"),
    ],
)
def test_changes_of_another_scene_are_refused(change: RowChange, message: str) -> None:
    scene, state = numbered(3)
    store = ParameterStore(scene, state)
    with pytest.raises(PocketGSError, match=message):
        store.change_rows(change)
    assert_identical(store.scene, scene)


def test_changes_may_be_given_as_lists() -> None:
    scene, state = numbered(3)
    store = ParameterStore(scene, state)
    values = {"means": ([], np.zeros((0, 3))), "quaternions": ([1], [[2.0, 0.0, 0.0, 0.0]])}
    store.change_rows(RowChange.of_values(3, values))
    assert_identical(replace(store.scene, quaternions=scene.quaternions), scene)
    assert store.scene.quaternions[1].tolist() == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("failing", range(8))
def test_a_scene_that_outgrows_memory_stays(
    make_gaussians: MakeGaussians, monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    """Whichever array does not fit; it may grow and train later."""
    camera = camera_in_front(40, 30, 40.0)
    engine, expected = (engine_with(make_gaussians(count=50, sh_degree=1), camera) for _ in range(2))
    doubled = RowChange(np.arange(100, dtype=np.int32) // 2, np.zeros(100, bool))
    allocate, calls = np.empty, iter(range(100))

    def scarce(shape: tuple[int, ...], dtype: type) -> np.ndarray:
        if len(shape) > 0 and shape[0] == 100 and next(calls) == failing:
            raise MemoryError("no memory")
        return allocate(shape, dtype)

    with monkeypatch.context() as patch:
        patch.setattr("pocketgs.splat.store.np.empty", scarce)
        with pytest.raises(PocketGSError, match="100 Gaussians do not fit into memory"):
            engine.change_rows(doubled)
    for each in (engine, expected):
        each.step(0, STEP)
    assert_identical(engine.download(), expected.download())
    for each in (engine, expected):
        each.change_rows(doubled)
        each.step(0, STEP)
    assert_identical(engine.download(), expected.download())


@pytest.mark.parametrize("engine", ["cpu", "webgpu"])
def test_quaternions_of_any_length_may_be_set(
    request: pytest.FixtureRequest, make_gaussians: MakeGaussians, engine: str
) -> None:
    if engine == "webgpu":
        request.getfixturevalue("adapter")
    scene, camera = make_gaussians(count=20, sh_degree=0), camera_in_front(40, 30, 40.0)
    tested = create_engine(EngineOptions(engine))
    tested.upload(scene)
    expected = tested.render(camera).image
    longer = 3.0 * scene.quaternions
    tested.change_rows(RowChange.of_values(20, {"quaternions": (np.arange(20), longer)}))
    np.testing.assert_allclose(tested.render(camera).image, expected, atol=1e-5)


def engine_with(scene: Gaussians, camera: Camera, state: OptimiserState | None = None) -> CpuEngine:
    engine = CpuEngine()
    engine.set_views([photograph(camera)])
    engine.upload(scene, state)
    return engine


def test_rows_of_an_empty_scene(make_gaussians: MakeGaussians) -> None:
    store = ParameterStore(make_gaussians(count=0))
    store.change_rows(RowChange.of_values(0, {}))
    assert store.count == 0
    assert store.scene.sh.shape == (0, 16, 3)


def test_training_goes_on_as_if_the_changed_scene_had_been_uploaded(make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(40, 30, 40.0)
    engine = engine_with(make_gaussians(count=50, sh_degree=1), camera)
    engine.step(0, STEP)
    sources = np.array([*range(10, 50), *range(5, 45), 7], np.int32)
    engine.change_rows(RowChange(sources, np.arange(81) >= 40))
    other = engine_with(engine.download(), camera, engine.optimiser_state())
    for each in (engine, other):
        each.step(0, STEP)
        each.change_rows(RowChange(np.arange(3, 20, dtype=np.int32), np.zeros(17, bool)))
        each.step(0, STEP)
    assert engine.count == 17
    assert_identical(engine.download(), other.download())


def test_rows_that_the_next_view_does_not_show_have_no_gradient_after_a_change(make_gaussians: MakeGaussians) -> None:
    """Two groups, each seen by one of two views."""
    scene = make_gaussians(count=2 * CLUSTER, sh_degree=0)
    scene.means[CLUSTER:, 0] += 1000.0
    here, there = camera_in_front(40, 30, 40.0), camera_in_front(40, 30, 40.0)
    there.world_to_camera[0, 3] = -1000.0
    engine, other = CpuEngine(), CpuEngine()
    for each in (engine, other):
        each.set_views([photograph(here), photograph(there)])
    engine.upload(scene)
    step = replace(STEP, loss=LossSettings())
    engine.step(0, step)
    engine.change_rows(RowChange(np.arange(2 * CLUSTER, dtype=np.int32), np.zeros(2 * CLUSTER, bool)))
    other.upload(engine.download(), engine.optimiser_state())
    for each in (engine, other):
        each.step(1, step)
    assert_identical(engine.download(), other.download())


@pytest.mark.parametrize(("width", "height"), [(40, 30), (30, 40)])
def test_statistics_are_those_of_the_reference(make_gaussians: MakeGaussians, width: int, height: int) -> None:
    camera = camera_in_front(width, height, 40.0)
    scene = make_gaussians(count=40, sh_degree=0)
    engine = engine_with(scene, camera)
    still = StepSettings(LearningRates(*[0.0] * 6), LossSettings("l2"), statistics=True)
    for _ in range(2):
        engine.step(0, still)
    found = engine.statistics()
    projection = project(Scene.of(scene), camera)
    raster = rasterize(projection, camera, np.zeros(3))
    _, d_image = photometric_loss(raster.image, photograph(camera).image / 255.0, LossSettings("l2"), None)
    backward = rasterize_backward(projection, camera, raster, d_image)
    gradient = backward.means * (width / 2, height / 2)
    visible = projection.visible
    np.testing.assert_array_equal(found.seen, 2.0 * visible)
    np.testing.assert_allclose(found.screen_gradients, 2 * np.linalg.norm(gradient, axis=1), rtol=2e-3, atol=1e-7)
    least = np.linalg.eigvalsh(projection.conics[visible])[:, 0]
    np.testing.assert_allclose(found.radii[visible], 3 / np.sqrt(least) / 40, rtol=1e-3)
    assert not found.radii[~visible].any()
    half = replace(found, screen_gradients=found.screen_gradients / 2, seen=found.seen / 2)
    engine.restart_statistics(half)
    engine.step(0, still)
    np.testing.assert_allclose(engine.statistics().screen_gradients, found.screen_gradients, rtol=1e-6)
    engine.change_rows(RowChange.of_values(40, {}))
    assert not engine.statistics().seen.any()


def test_radii_are_the_largest_in_any_view(make_gaussians: MakeGaussians) -> None:
    scene = make_gaussians(count=20, sh_degree=0)
    frames = [photograph(camera_in_front(40, 30, focal)) for focal in (20.0, 40.0)]
    still = StepSettings(LearningRates(*[0.0] * 6), LossSettings("l2"), statistics=True)
    radii = []
    for views in ((0,), (1,), (0, 1), (1, 0)):
        engine = CpuEngine()
        engine.set_views(frames)
        engine.upload(scene)
        for view in views:
            engine.step(view, still)
        radii.append(engine.statistics().radii)
    assert (radii[0] != radii[1]).any()
    for found in radii[2:]:
        np.testing.assert_allclose(found, np.maximum(radii[0], radii[1]), rtol=1e-5)


def test_errors_are_weighed_by_contributions(make_gaussians: MakeGaussians) -> None:
    """The sum over Gaussians is that of the error times alpha; a single Gaussian's is that of its own pixels."""
    camera = camera_in_front(40, 30, 40.0)
    photo = photograph(camera, masked=True)
    for count in (1, 40):
        scene = make_gaussians(count=count, sh_degree=0)
        engine = CpuEngine()
        engine.set_views([photo])
        engine.upload(scene)
        engine.step(0, StepSettings(LearningRates(*[0.0] * 6), errors=True))
        rendering = engine.render(camera)
        error = np.abs(rendering.image - photo.image / 255.0).mean(axis=2) * photo.mask
        assert engine.statistics().errors.sum() == pytest.approx((error * rendering.alpha).sum(), rel=1e-4)


def test_each_gaussians_error_is_that_of_the_reference(make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(40, 30, 40.0)
    photo, scene = photograph(camera, masked=True), make_gaussians(count=40, sh_degree=0)
    engine = engine_with(scene, camera)
    engine.set_masks([photo.mask])
    engine.step(0, StepSettings(LearningRates(*[0.0] * 6), errors=True))
    rasterizer = Rasterizer("reference")
    seen = rasterizer.forward(scene, camera, ("rgb", "features"), features=np.ones((40, 1)))
    error = np.abs(seen.rgb - photo.image / 255.0).mean(axis=2) * photo.mask
    expected = rasterizer.backward(seen, features=error[..., None]).features[:, 0]
    np.testing.assert_allclose(engine.statistics().errors, expected, atol=1e-3 * expected.max())


def test_errors_are_those_of_images_in_the_photographs_colours(make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(40, 30, 40.0)
    photo, other = photograph(camera), photograph(camera, seed=12)
    engine = CpuEngine()
    engine.set_views([photo, other])
    engine.upload(make_gaussians(count=40, sh_degree=0))
    still = StepSettings(LearningRates(*[0.0] * 6), colours=ColourSettings(0.1))
    engine.step(0, still)
    matrix = transforms_of(engine.optimiser_state().colours)[0]
    engine.step(0, replace(still, errors=True))
    rendering = engine.render(camera)
    transformed = rendering.image @ matrix[:, :3].T + matrix[:, 3]
    error, untransformed = (
        (np.abs(image - photo.image / 255.0).mean(axis=2) * rendering.alpha).sum()
        for image in (transformed, rendering.image)
    )
    assert abs(error - untransformed) > 0.01 * error
    assert engine.statistics().errors.sum() == pytest.approx(error, rel=1e-4)


def test_nothing_is_collected_that_was_not_asked_for(make_gaussians: MakeGaussians) -> None:
    engine = engine_with(make_gaussians(), camera_in_front(20, 20, 20.0))
    engine.step(0, replace(STEP, statistics=False))
    assert engine.memory()["statistics"] == 0
    assert not engine.statistics().seen.any()


def test_coefficients_above_the_degree_wait(make_gaussians: MakeGaussians) -> None:
    scene = make_gaussians(sh_degree=2)
    engine = engine_with(scene, camera_in_front(20, 20, 20.0))
    engine.step(0, replace(STEP, sh_degree=1))
    trained = engine.download()
    np.testing.assert_array_equal(trained.sh[:, 4:], scene.sh[:, 4:])
    assert (trained.sh[:, :4] != scene.sh[:, :4]).any()
    moments = engine.optimiser_state().second_moments
    assert not moments[:, first_column("sh") + 12 :].any()
    assert moments[:, first_column("sh") + 3 : first_column("sh") + 12].any()
    whole, same = (engine_with(scene, camera_in_front(20, 20, 20.0)) for _ in range(2))
    whole.step(0, STEP)
    same.step(0, replace(STEP, sh_degree=3))
    assert_identical(whole.download(), same.download())


def test_the_weight_of_sizes_is_their_gradient(make_gaussians: MakeGaussians) -> None:
    scene = make_gaussians(count=6)
    gradients = np.zeros((6, ParameterLayout(16).columns), np.float32)
    value = regularise(scene.log_scales, scene.opacity_logits, 0.0, 0.0, 0.3, gradients)
    assert value == pytest.approx(0.3 * scene.scales.sum() / 6, rel=1e-5)
    np.testing.assert_allclose(gradients[:, 3:6], 0.3 * scene.scales / 6, rtol=1e-5)


def test_noise_has_the_covariance_of_its_gaussian() -> None:
    """σ(-k (o - t)) Σ η has the covariance (σ Σ)²; opaque Gaussians hardly move."""
    count = 20_000
    turn = np.array([0.8, 0.2, -0.4, 0.4])
    one = Gaussians(np.zeros((1, 3)), np.log([[1.0, 0.5, 0.1]]), turn[None], np.array([-9.0]), np.zeros((1, 1, 3)))
    scene = one.select(np.zeros(count, int))
    scene.opacity_logits[count // 2 :] = 3.0
    arrays = SceneArrays.of(scene)._replace(quaternions=scene.unit_quaternions)
    for threads in (1, 2):
        means = [np.zeros((count, 3), np.float32) for _ in range(2)]
        for moved, seed in zip(means, (7, 8), strict=True):
            add_noise(arrays._replace(means=moved), 2.0, seed, threads)
        if threads == 1:
            alone = means[0]
    np.testing.assert_array_equal(alone, means[0])
    assert (means[0] != means[1]).any()
    rotation = rotation_matrices(turn[None])[0]
    covariance = rotation @ np.diag([1.0, 0.25, 0.01]) @ rotation.T
    factor = 2.0 / (1.0 + np.exp(100 * (one.opacities[0] - 0.005)))
    faint = means[0][: count // 2]
    np.testing.assert_allclose(np.cov(faint.T), factor**2 * covariance @ covariance, atol=0.1)
    np.testing.assert_allclose(faint.mean(axis=0), 0, atol=0.05)
    assert np.abs(means[0][count // 2 :]).max() < 1e-20


def test_shaken_steps_repeat(make_gaussians: MakeGaussians) -> None:
    scene, camera = make_gaussians(), camera_in_front(20, 20, 20.0)
    scene.opacity_logits[:6] = -6.0
    shaken = []
    for noise in (PositionNoise(1.0, 3), PositionNoise(1.0, 3), None):
        engine = engine_with(scene, camera)
        engine.step(0, replace(STEP, noise=noise))
        shaken.append(engine.download().means)
    np.testing.assert_array_equal(shaken[0], shaken[1])
    assert np.abs(shaken[0][:6] - shaken[2][:6]).min() > 0
