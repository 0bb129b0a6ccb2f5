"""A browser replays the same passes: it takes every shader, and gives the native engine's images and parameters."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from playwright.sync_api import Browser, Error, Page

import pocketgs.gpu
from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.geometry.camera import Camera
from pocketgs.gpu.adapters import Adapter
from pocketgs.gpu.sizes import evaluate
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.depth.webgpu.passes import describe_sweep
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo
from pocketgs.prior.depth.webgpu.sweep_inputs import SweepInputs
from pocketgs.scene.gaussians import SH_DC, Gaussians
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.settings import AdamSettings, LearningRates, LossSettings, StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.splat.webgpu.frame_values import update_values, view_values
from pocketgs.splat.webgpu.passes import describe_training
from pocketgs.splat.webgpu.photographs import packed
from pocketgs.splat.webgpu.scene_columns import to_columns
from pocketgs.splat.webgpu.variant import Variant
from splat.webgpu.every_description import every_shader
from splat.webgpu.variants import shared_engine
from static_site.hosting import hosting
from viewer.browsing import open_browser

VARIANTS = [
    pytest.param(Variant("f32", "recompute"), id="f32-recompute"),
    pytest.param(Variant("f16", "cache"), id="f16-cache"),
    pytest.param(Variant("f32", "cache"), id="f32-cache", marks=pytest.mark.slow),
    pytest.param(Variant("f16", "recompute"), id="f16-recompute", marks=pytest.mark.slow),
]
"""Two of them cover what the others combine: a GPU in software takes its time to compile them."""

TOLERANCES = {"f32": 1e-4, "f16": 1e-3}
"""Of parameters after the steps, in which some move by 3e-2."""

STEPS = 3
# Adam divides gradients by their own size: with its usual epsilon, one that is nothing but rounding gives a whole step.
SETTINGS = StepSettings(
    LearningRates(1e-3, 5e-3, 4e-3, 1e-2, 1e-2, 1e-3),
    LossSettings(scale_weight=1e-3, opacity_weight=1e-3),
    AdamSettings(epsilon=1e-6),
    background=(0.2, 0.4, 0.6),
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as running:
        yield running


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the page: WebGPU needs https or localhost."""
    folder = tmp_path_factory.mktemp("site") / "site"
    shutil.copytree(Path(__file__).parent / "browser", folder)
    shutil.copytree(Path(pocketgs.gpu.__file__).parent, folder / "gpu", ignore=ignore_all_but_scripts)
    with hosting(folder) as host:
        yield f"{host.address}page.html"


def ignore_all_but_scripts(_: str, names: list[str]) -> list[str]:
    return [name for name in names if not name.endswith(".js")]


@pytest.fixture(scope="module")
def page(browser: Browser, address: str) -> Page:
    page = browser.new_page()
    page.goto(address)
    return page


@pytest.fixture(scope="module")
def camera() -> Camera:
    """A view whose sides no tile divides."""
    pose = np.eye(4)
    pose[2, 3] = 4.0
    return Camera(61, 45, 60.0, 62.0, 29.7, 23.1, pose)


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    """Gaussians of all shapes, some of them outside the view."""
    rng, count = np.random.default_rng(7), 400
    sh = rng.normal(0.0, 0.1, (count, 9, 3))
    sh[:, 0] = (rng.uniform(0.1, 0.9, (count, 3)) - 0.5) / SH_DC
    means = rng.uniform(-2.2, 2.2, (count, 3))
    log_scales = np.log(0.12) + rng.normal(0.0, 0.5, (count, 3))
    return Gaussians(means, log_scales, rng.normal(0.0, 1.0, (count, 4)), rng.uniform(-2.0, 3.0, count), sh)


@pytest.fixture(scope="module")
def photograph(camera: Camera) -> Frame:
    image = np.random.default_rng(8).integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    return Frame("photo", camera, image)


@pytest.fixture(scope="module", params=VARIANTS)
def variant(request: pytest.FixtureRequest) -> Variant:
    return request.param


@pytest.fixture(scope="module")
def replayed(page: Page, variant: Variant, scene: Gaussians, photograph: Frame) -> dict[str, Any]:
    """Render and train the scene in the page: its image, then parameters and losses after training."""
    description, camera = describe_training(variant), photograph.camera
    given = given_numbers(scene, camera)
    shape, sh = to_columns(scene)
    moments = np.zeros(10 * len(scene) + sh.size)
    floats = {"shape": shape, "sh": sh, "first_moments": moments, "second_moments": moments}
    updates = [update_values(SETTINGS, camera, given, step) for step in range(1, STEPS + 1)]
    job = {
        "description": description.to_json(),
        "given": given,
        "floats": plain({name: values.reshape(-1) for name, values in floats.items()}),
        "words": plain({"photographs": packed(photograph), "status": [0, 0, 0]}),
        "view": plain(view_values(camera, SETTINGS.background, near_plane(scene.means), description.symbols(given))),
        "updates": [plain(update) for update in updates],
        "results": {"shape": shape.size, "sh": sh.size, "losses": STEPS},
    }
    return page.evaluate("job => replay(job)", job)


@pytest.fixture
def engine(adapter: Adapter, variant: Variant, scene: Gaussians, photograph: Frame) -> WebGpuEngine:
    """The native engine with the same passes and the same scene."""
    engine = shared_engine(EngineOptions("webgpu", precision=variant.precision, replay=variant.replay))
    engine.set_views([photograph])
    engine.upload(scene)
    return engine


def given_numbers(scene: Gaussians, camera: Camera) -> dict[str, int]:
    return {
        "gaussians": len(scene),
        "capacity": len(scene),
        "coefficients": scene.sh.shape[1],
        "width": camera.width,
        "height": camera.height,
        "intersections": 20_000,
        "photograph_pixels": camera.width * camera.height,
        "replay_depth": 32,
        "regularised": 1,
        "collecting": 1,
        "photographs": 1,
        "listed": 0,
        "structural": 1,
    }


def plain(values: Mapping[str, ArrayLike]) -> dict[str, Any]:
    return {name: np.asarray(value).tolist() for name, value in values.items()}


def test_browser_takes_every_shader(replayed: dict[str, Any]) -> None:
    assert replayed["complaints"] == []


def test_same_image(replayed: dict[str, Any], engine: WebGpuEngine, camera: Camera) -> None:
    expected = engine.render(camera, SETTINGS.background).image
    assert np.ptp(expected) > 0.5
    image = np.reshape(replayed["image"], (camera.height, camera.width, 4))[..., :3]
    np.testing.assert_allclose(image, expected, rtol=0, atol=1e-3)


def test_same_steps(replayed: dict[str, Any], variant: Variant, engine: WebGpuEngine, scene: Gaussians) -> None:
    for _ in range(STEPS):
        engine.step(0, SETTINGS)
    assert replayed["status"][:2] == [STEPS, 0]
    np.testing.assert_allclose(np.mean(replayed["losses"]), engine.loss(STEPS), rtol=1e-5)
    for name, before, after in zip(("shape", "sh"), to_columns(scene), to_columns(engine.download()), strict=True):
        assert np.abs(after - before).max() > 0.02, name
        error = np.abs(np.reshape(replayed[name], after.shape) - after).max()
        assert error < TOLERANCES[variant.precision], name


@pytest.mark.usefixtures("adapter")
def test_same_sweep(page: Page) -> None:
    """The prior's passes, of which the browser is only given data."""
    key, *others = true_capture(40, 30, frames=4, points=10).train
    search, settings, stereo = DepthRange(1.5, np.inf, 33), SweepSettings(), WebGpuStereo()
    expected = stereo.sweep(key, others, search, settings)
    inputs, description = SweepInputs.of(key, others, search, settings), stereo.sweeping.description
    given = {**inputs.given, "bands": 1}
    of_words = {name for name, content in inputs.buffers.items() if content.dtype == np.uint32}
    contents = {name: content.reshape(-1) for name, content in inputs.buffers.items()}
    job = {
        "description": description.to_json(),
        "given": given,
        "sequence": "sweep",
        "floats": plain({name: content for name, content in contents.items() if name not in of_words}),
        "words": plain({name: contents[name] for name in of_words}),
        "uniforms": {"sweep": plain(inputs.uniform(description.symbols(given)))},
        "results": {"depths": expected.depth.size, "margins": expected.margin.size},
    }
    found = page.evaluate("job => runSequence(job)", job)
    assert found["complaints"] == []
    assert np.count_nonzero(expected.depth) > 1000
    depth = np.reshape(found["depths"], expected.depth.shape)
    np.testing.assert_array_equal(depth > 0, expected.depth > 0)
    known = depth > 0
    steps = np.abs(1 / depth[known] - 1 / expected.depth[known]) / expected.step
    assert np.mean(steps < 0.01) > 0.98
    assert np.mean(np.abs(np.reshape(found["margins"], known.shape) - expected.margin) < 1e-3) > 0.98


def test_browser_compiles_every_shader_with_the_least_limits(page: Page) -> None:
    """Shaders that the other tests do not compile."""
    compiled = [
        describe_training(Variant("f32", "recompute")),
        describe_training(Variant("f16", "cache")),
        describe_sweep(),
    ]
    found = page.evaluate("json => compileAll(json)", every_shader(compiled).to_json())
    assert found == {"complaints": [], "limits": [8, 128 << 20, 16_384]}


def test_same_sizes(page: Page, scene: Gaussians, camera: Camera) -> None:
    description = describe_training(Variant("f16", "cache"))
    symbols = {**description.symbols(given_numbers(scene, camera)), "drawn_tiles": 5}
    passes = [one for sequence in description.sequences.values() for one in sequence.passes]
    expressions = [*description.definitions.values(), *description.buffers.values(), *(one.when for one in passes)]
    expressions += [one.groups for one in passes if one.groups]
    expressions += ["12 - 3 - 4", "2 * (3 + 4) > 13 + 1", "1 + 2 < 4", "max(ceil_div(7, 2), 3 * 1)"]
    found = page.evaluate("([expressions, symbols]) => evaluateAll(expressions, symbols)", [expressions, symbols])
    assert found == [evaluate(expression, symbols) for expression in expressions]


@pytest.mark.parametrize("expression", ["", "1 +", "1 2", "(1", "max(1)", "width", "alert(1)", "1; 2", "constructor"])
def test_what_is_no_size_is_refused(page: Page, expression: str) -> None:
    with pytest.raises(Error, match="expected"):
        page.evaluate("expression => evaluateAll([expression], {})", expression)


def test_too_large_a_buffer_is_refused(page: Page) -> None:
    with pytest.raises(Error, match=r"buffer 'image' would need 1000000 MB, the device allows \d+ MB"):
        page.evaluate("json => reserve(json, {image: 1e12})", describe_training(Variant()).to_json())


FILL_MEMORY = """async (json) => {
    const [{ openDevice }, { Executor }, { Description }] = await Promise.all(
        ["device", "executor", "description"].map((name) => import(new URL(`gpu/${name}.js`, document.baseURI))),
    );
    const device = await openDevice();
    const executor = new Executor(device, new Description(json));
    await executor.reserve({ image: 64, splats: 64 });
    const popErrorScope = device.popErrorScope;
    device.popErrorScope = async () => (await popErrorScope.call(device)) ?? { message: "full" };
    const said = await executor.reserve({ image: 256, splats: 64 }).catch(({ message }) => message);
    delete device.popErrorScope;
    await executor.reserve({ image: 128 });
    return [said, executor.buffer("image").size, executor.buffer("splats").size];
}"""


def test_a_buffer_that_found_no_memory_is_made_anew(page: Page) -> None:
    said, image, splats = page.evaluate(FILL_MEMORY, describe_training(Variant()).to_json())
    assert "memory is full" in said
    assert (image, splats) == (128, 64)


def test_browser_without_webgpu_is_told_so(browser: Browser, address: str) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.add_init_script("delete Navigator.prototype.gpu")
        page.goto(address)
        with pytest.raises(Error, match="no WebGPU"):
            page.evaluate("json => reserve(json, {})", describe_training(Variant()).to_json())
