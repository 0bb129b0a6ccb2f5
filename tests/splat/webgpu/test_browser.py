"""A browser replays the same passes: it takes every shader, and gives the native engine's images and parameters."""

from __future__ import annotations

import itertools
import os
import shutil
import threading
from collections.abc import Iterator, Mapping
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from playwright.sync_api import Browser, Page, sync_playwright

import pocketgs.splat.webgpu
from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.gaussians import SH_DC, Gaussians
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import AdamSettings, LearningRates, LossSettings, StepSettings
from pocketgs.splat.webgpu.engine import LEAST_ENTRIES, REPLAY_DEPTH, WebGpuEngine
from pocketgs.splat.webgpu.frame_values import update_values, view_values
from pocketgs.splat.webgpu.passes import Variant, describe
from pocketgs.splat.webgpu.photographs import packed
from pocketgs.splat.webgpu.scene_columns import to_columns
from pocketgs.splat.webgpu.sizes import evaluate

BROWSERS = ("chromium", "google-chrome", "chromium-browser")
FLAGS = (
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
)
VARIANTS = [
    Variant(precision, replay) for precision, replay in itertools.product(("f32", "f16"), ("recompute", "cache"))
]
STEPS = 3
# Adam divides gradients by their own size. Where rounding alone makes them up, as it does where true gradients cancel,
# the default epsilon would blow them up to whole steps.
SETTINGS = StepSettings(
    LearningRates(1e-3, 5e-3, 4e-3, 1e-2, 1e-2, 1e-3),
    LossSettings(scale_weight=1e-3, opacity_weight=1e-3),
    AdamSettings(epsilon=1e-6),
    background=(0.2, 0.4, 0.6),
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        unavailable(f"no browser: found none of {', '.join(BROWSERS)}")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        yield running
        running.close()


def unavailable(why: str) -> None:
    """Skip, but on the machines that are there to run everything."""
    if os.environ.get("CI"):
        pytest.fail(why)
    pytest.skip(why)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where the page is served: WebGPU wants https or this very machine."""
    folder = tmp_path_factory.mktemp("site") / "site"
    shutil.copytree(Path(__file__).parent / "browser", folder)
    shutil.copytree(Path(pocketgs.splat.webgpu.__file__).parent, folder / "webgpu", ignore=ignore_all_but_scripts)
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(QuietHandler, directory=folder)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/page.html"
        server.shutdown()


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


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


@pytest.fixture(params=VARIANTS, ids=lambda variant: f"{variant.precision}-{variant.replay}")
def variant(request: pytest.FixtureRequest) -> Variant:
    return request.param


def given_numbers(scene: Gaussians, camera: Camera) -> dict[str, int]:
    return {
        "gaussians": len(scene),
        "coefficients": scene.sh.shape[1],
        "width": camera.width,
        "height": camera.height,
        "entries": LEAST_ENTRIES,
        "photograph_pixels": camera.width * camera.height,
        "replay_depth": REPLAY_DEPTH,
        "regularised": 1,
        "structural": 1,
    }


def plain(values: Mapping[str, ArrayLike]) -> dict[str, Any]:
    return {name: np.asarray(value).tolist() for name, value in values.items()}


def train_in_page(page: Page, variant: Variant, scene: Gaussians, photograph: Frame) -> dict[str, Any]:
    """The image of the scene before training, and the parameters after it, as the page finds them."""
    description, camera = describe(variant), photograph.camera
    given = given_numbers(scene, camera)
    shape, sh = to_columns(scene)
    moments = np.zeros((10 * len(scene)) + sh.size).tolist()
    updates = [update_values(SETTINGS, camera, len(scene), step) for step in range(1, STEPS + 1)]
    job = {
        "description": description.to_json(),
        "given": given,
        "floats": {
            "shape": shape.reshape(-1).tolist(),
            "sh": sh.reshape(-1).tolist(),
            "first_moments": moments,
            "second_moments": moments,
        },
        "words": {"photographs": packed(photograph).tolist(), "status": [0, 0, 0]},
        "view": plain(view_values(camera, SETTINGS.background, description.symbols(given))),
        "updates": [plain(update) for update in updates],
        "results": {"shape": shape.size, "sh": sh.size, "first_moments": len(moments), "losses": STEPS},
    }
    return page.evaluate("job => train(job)", job)


@pytest.fixture
def engine(variant: Variant, scene: Gaussians, photograph: Frame) -> WebGpuEngine:
    """The native engine with the same passes."""
    try:
        engine = WebGpuEngine(EngineOptions(precision=variant.precision, replay=variant.replay, portable=True))
    except PocketGSError as error:
        unavailable(str(error))
    engine.set_views([photograph])
    engine.upload(scene)
    return engine


def test_browser_takes_every_shader(page: Page, variant: Variant) -> None:
    found = page.evaluate("json => compile(json)", describe(variant).to_json())
    assert found == {"messages": [], "errors": []}


def test_same_image_and_same_steps(
    page: Page, variant: Variant, engine: WebGpuEngine, scene: Gaussians, photograph: Frame
) -> None:
    camera = photograph.camera
    found = train_in_page(page, variant, scene, photograph)
    assert found["errors"] == []
    assert found["status"][:2] == [STEPS, 0]

    rendering = engine.render(camera, SETTINGS.background)
    image = np.reshape(found["image"], (camera.height, camera.width, 4))
    assert np.ptp(rendering.image) > 0.5
    print('image', np.abs(image[..., :3]-rendering.image).max())
    for _ in range(STEPS):
        engine.step(0, SETTINGS)
    shape, sh = to_columns(engine.download())
    before = to_columns(scene)
    print('moved', np.abs(shape-before[0]).max(), np.abs(sh-before[1]).max())
    print('shape', np.sort(np.abs(np.ravel(shape)-found["shape"]))[-5:], np.sort(np.abs(np.ravel(sh)-found["sh"]))[-5:])
    state = engine.optimiser_state()
    print('moments', np.abs(np.ravel(state.first_moments.T)-found["first_moments"]).max(), np.abs(state.first_moments).max())
    print('loss', found["losses"], engine.loss(3), np.mean(found["losses"]))
