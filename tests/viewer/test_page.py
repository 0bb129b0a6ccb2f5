"""The page in a browser: it renders like the engine, and responds to user actions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, expect

from pocketgs.geometry.camera import Camera
from pocketgs.scene.formats import ply, splat, spz
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.webgpu.frame_values import view_values
from pocketgs.viewer.content import Content, View
from pocketgs.viewer.server import serving
from viewer.browsing import PATIENCE, Visit, visiting
from viewer.marks import HEIGHT, MARKS, UP, WIDTH, cameras_around, marked_scene, marks, psnr, size_of

BACKGROUND = (0.1, 0.2, 0.3)


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    return marked_scene()


@pytest.fixture(scope="module")
def cameras() -> list[Camera]:
    return cameras_around()


@pytest.fixture(scope="module")
def content(scene: Gaussians, cameras: list[Camera], tmp_path_factory: pytest.TempPathFactory) -> Content:
    path = tmp_path_factory.mktemp("shown") / "scene.ply"
    ply.write_gaussians(path, scene)
    photo = np.full((HEIGHT, WIDTH, 3), (255, 255, 0), np.uint8)
    views = [View(f"{i}.jpg", camera, i == 1, photo) for i, camera in enumerate(cameras)]
    Image.fromarray(photo // 2).save(path.with_name("moved.png"))
    views[0] = replace(views[0], transients=path.with_name("moved.png"))
    return Content("marks", path, False, BACKGROUND, tuple(views), UP, (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def url(content: Content) -> Iterator[str]:
    with serving(content) as page:
        yield page.url


@pytest.fixture(scope="module")
def opened(browser: Browser, url: str) -> Iterator[Visit]:
    with visiting(browser, url, WIDTH, HEIGHT) as visit:
        visit.until_drawn()
        assert visit.complaints == []
        yield visit


@pytest.fixture(scope="module")
def replaced(browser: Browser, url: str) -> Iterator[Visit]:
    """Another one, in which tests show other scenes, one after the other."""
    with visiting(browser, url, WIDTH, HEIGHT) as visit:
        visit.until_drawn()
        yield visit


@pytest.fixture
def visit(opened: Visit) -> Iterator[Visit]:
    """The page, which every test leaves without anything to complain of and back at its camera."""
    opened.complaints.clear()
    yield opened
    for key in ("Escape", "1", "r"):
        opened.page.keyboard.press(key)
    assert opened.complaints == []


@pytest.fixture(scope="module")
def engine(scene: Gaussians) -> CpuEngine:
    engine = CpuEngine()
    engine.upload(scene)
    return engine


def described(camera: Camera) -> dict[str, Any]:
    """As the page has it."""
    numbers = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    return {**numbers, "world_to_camera": camera.world_to_camera.ravel().tolist()}


def test_it_loads(visit: Visit, scene: Gaussians) -> None:
    expect(visit["#title"]).to_have_text("marks")
    expect(visit["#stats"]).to_contain_text(f"{len(scene)} splats")
    expect(visit["#loading"]).to_be_hidden()
    expect(visit["#message"]).to_be_hidden()


def test_picture_is_the_engines(visit: Visit, engine: CpuEngine, cameras: list[Camera]) -> None:
    """At the held-out camera, where it starts, and at the next one."""
    expect(visit["#camera-name"]).to_have_text("1.jpg, held out")
    expected = np.clip(engine.render(cameras[1], BACKGROUND).image, 0, 1)
    assert psnr(visit.picture(), expected) > 40
    visit["#next"].click()
    expect(visit["#camera-name"]).to_have_text("2.jpg")
    assert psnr(visit.picture(), np.clip(engine.render(cameras[2], BACKGROUND).image, 0, 1)) > 40
    visit["#previous"].click()
    assert psnr(visit.picture(), expected) > 40


def test_values_for_the_shaders_are_those_of_python(visit: Visit, cameras: list[Camera]) -> None:
    symbols = {"gaussians": 5, "coefficients": 4, "intersections": 77, "replay_depth": 0}
    camera = cameras[2]
    found = visit.page.evaluate(
        """async ([camera, background, symbols]) => {
            const { viewValues } = await import(new URL("page/drawing/view_values.js", document.baseURI));
            return viewValues(camera, background, 0.25, symbols);
        }""",
        [described(camera), BACKGROUND, symbols],
    )
    expected = view_values(camera, BACKGROUND, 0.25, symbols)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, err_msg=name, atol=1e-9)


def test_dragging_turns_the_scene(visit: Visit) -> None:
    """Points in front of the target follow the pointer."""
    before = marks(visit.picture())
    visit.drag(30, 0)
    after = marks(visit.picture())
    assert after["red"][0] > before["red"][0] + 5
    before = after
    visit.drag(0, 20)
    assert marks(visit.picture())["red"][1] > before["red"][1] + 2


@pytest.mark.parametrize("how", ["right button", "shift"])
def test_panning_moves_the_target_with_the_pointer(visit: Visit, how: str) -> None:
    before = marks(visit.picture())
    if how == "shift":
        visit.page.keyboard.down("Shift")
    visit.drag(30, 12, "right" if how == "right button" else "left")
    visit.page.keyboard.up("Shift")
    after = marks(visit.picture())
    # Green and blue lie left and right of the target, at its distance.
    middle = (after["green"] + after["blue"] - before["green"] - before["blue"]) / 2
    np.testing.assert_allclose(middle, (30, 12), atol=4)


def test_wheel_comes_nearer(visit: Visit) -> None:
    before = size_of(marks(visit.picture()))
    visit.page.mouse.move(200, 100)
    visit.page.mouse.wheel(0, -120)
    assert size_of(marks(visit.picture())) > 1.1 * before


def test_one_finger_turns(visit: Visit) -> None:
    before = marks(visit.picture())
    visit.touch(((200, 100), (230, 100)))
    assert marks(visit.picture())["red"][0] > before["red"][0] + 5


def test_two_fingers_pinch_and_pan(visit: Visit) -> None:
    before = marks(visit.picture())
    visit.touch(((180, 100), (172, 100)), ((220, 100), (228, 100)))
    assert size_of(marks(visit.picture())) > 1.3 * size_of(before)
    visit.page.keyboard.press("r")
    before = marks(visit.picture())
    visit.touch(((180, 100), (200, 110)), ((220, 100), (240, 110)))
    after = marks(visit.picture())
    middle = (after["green"] + after["blue"] - before["green"] - before["blue"]) / 2
    np.testing.assert_allclose(middle, (20, 10), atol=4)


def tap(visit: Visit, key: str) -> None:
    """Hold a key for 200 ms of the page's clock: messages between the browser and this process may be seconds late."""
    visit.page.evaluate(
        """() => addEventListener("keydown", ({ key, code }) => {
            setTimeout(() => dispatchEvent(new KeyboardEvent("keyup", { key, code })), 200);
        }, { once: true })"""
    )
    visit.page.keyboard.down(key)
    visit["#canvas[aria-busy=false]"].wait_for(timeout=20_000)
    visit.page.keyboard.up(key)


@pytest.mark.parametrize(("key", "grows", "right"), [("w", 1, 0), ("s", -1, 0), ("a", 0, 1), ("d", 0, -1)])
def test_keys_fly(visit: Visit, key: str, grows: int, right: int) -> None:
    """Forward and back, or sideways, which moves the picture the other way."""
    before = marks(visit.picture(), ["green", "blue"])
    for _ in range(20):
        tap(visit, key)
        after = marks(visit.picture(), ["green", "blue"])
        closer = grows * (size_of(after) - size_of(before)) if grows else 0.0
        aside = right * (after["green"][0] - before["green"][0])
        assert min(closer, aside) > -1
        # A busy machine may draw no frame while the key is held.
        if max(closer, aside) > 3:
            return
    raise AssertionError("it does not fly")


def test_flight_ends_with_the_command_key(visit: Visit) -> None:
    """Macs do not tell that a key is released while it is held."""
    visit.page.keyboard.down("w")
    visit["#canvas[aria-busy=true]"].wait_for()
    visit.page.evaluate("window.dispatchEvent(new KeyboardEvent('keyup', { key: 'Meta', code: 'MetaLeft' }))")
    visit["#canvas[aria-busy=false]"].wait_for(timeout=20_000)
    visit.page.keyboard.up("w")


def test_a_saved_picture_outlives_the_click(visit: Visit) -> None:
    """Browsers may fetch a download's address in a later task. A picture that is too large to encode is told of."""
    visit.page.evaluate(
        """() => {
            const [create, revoke] = [URL.createObjectURL, URL.revokeObjectURL];
            self.addresses = new Set();
            URL.createObjectURL = (content) => {
                const address = create.call(URL, content);
                self.addresses.add(address);
                return address;
            };
            URL.revokeObjectURL = (address) => {
                self.addresses.delete(address);
                revoke.call(URL, address);
            };
        }"""
    )
    visit.picture()
    assert visit.page.evaluate("addresses.size") == 1
    visit.page.evaluate(
        """() => {
            const encode = HTMLCanvasElement.prototype.toBlob;
            HTMLCanvasElement.prototype.toBlob = (done) => {
                HTMLCanvasElement.prototype.toBlob = encode;
                done(null);
            };
        }"""
    )
    visit["#screenshot"].click()
    expect(visit["#message-text"]).to_contain_text("could not encode the picture")
    visit["#message-close"].click()


def test_the_canvas_shows_that_it_has_the_focus(visit: Visit) -> None:
    visit.page.keyboard.press("Tab")
    visit["#canvas"].focus()
    expect(visit["#canvas"]).to_have_css("outline-style", "solid")
    expect(visit["#canvas"]).to_have_css("outline-offset", "-2px")
    visit["#canvas"].blur()


def test_reset_goes_back(visit: Visit) -> None:
    before = visit.picture()
    visit.drag(40, 10)
    visit.page.mouse.wheel(0, 100)
    assert psnr(visit.picture(), before) < 40
    visit["#reset"].click()
    assert psnr(visit.picture(), before) > 60


def test_appearances(visit: Visit) -> None:
    """Opaque discs cover the marks with their one colour; dots are few; depths are brightest at the nearest mark."""
    splats = visit.picture()
    places = marks(splats)
    pictures = {}
    for key, name in zip("234", ("points", "discs", "depth"), strict=True):
        visit.page.keyboard.press(key)
        expect(visit[f"[data-appearance={name}]"]).to_have_attribute("aria-pressed", "true", timeout=PATIENCE)
        pictures[name] = visit.picture()
    x, y = np.round(places["red"]).astype(int)
    np.testing.assert_allclose(pictures["discs"][y, x], (1, 0, 0), atol=0.02)
    reddish = {name: int((picture[..., 0] - picture[..., 1] > 0.9).sum()) for name, picture in pictures.items()}
    assert 1 <= reddish["points"] <= 12 < reddish["discs"]
    brightness = pictures["depth"].sum(axis=2)
    assert brightness[y, x] > np.quantile(brightness, 0.9)
    assert np.ptp(brightness) > 1.0


DEPTHS = """async ([near, unit]) => {
    const { openDevice } = await import(new URL("gpu/device.js", document.baseURI));
    const { Display } = await import(new URL("page/drawing/display.js", document.baseURI));
    const device = await openDevice();
    const canvas = Object.assign(document.createElement("canvas"), { width: 64, height: 1 });
    const image = device.createBuffer({ size: 16 * 64, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
    const opaque = Array.from({ length: 64 }, (_, i) => [unit * (1 + i / 16), 0, 0, 0]);
    device.queue.writeBuffer(image, 0, new Float32Array(opaque.flat()));
    const display = await Display.open(device, canvas);
    display.show(image, canvas, canvas, { background: [0, 0, 0], asDepth: true, near: near * unit });
    const seen = Object.assign(document.createElement("canvas"), { width: 64, height: 1 }).getContext("2d");
    seen.drawImage(canvas, 0, 0);
    device.destroy();
    return Array.from(seen.getImageData(0, 0, 64, 1).data);
}"""


def test_depths_look_the_same_in_every_unit(visit: Visit) -> None:
    """Such as millimetres: the nearest and the farthest of a scene differ as much as in metres."""
    metres, *others = (np.reshape(visit.page.evaluate(DEPTHS, [0.01, unit]), (64, 4)) for unit in (1, 1000, 1e-7))
    brightness = metres[:, :3].sum(axis=1)
    assert (np.diff(brightness) <= 0).all()
    assert np.ptp(brightness) > 255
    for other in others:
        np.testing.assert_allclose(other, metres, atol=3)


def test_an_appearance_without_room_leaves_the_picture(visit: Visit) -> None:
    """The GPU's memory is full once: the page says so, goes on as before, and the next try works."""
    before = visit.picture()
    visit.page.evaluate(
        """() => {
            const own = GPUDevice.prototype.popErrorScope;
            GPUDevice.prototype.popErrorScope = async function () {
                GPUDevice.prototype.popErrorScope = own;
                await own.call(this);
                return new GPUOutOfMemoryError("full");
            };
        }"""
    )
    visit.page.keyboard.press("2")
    expect(visit["#message"]).to_contain_text("the GPU's memory is full", timeout=PATIENCE)
    expect(visit["[data-appearance=splats]"]).to_have_attribute("aria-pressed", "true")
    assert psnr(visit.picture(), before) > 60
    visit.page.keyboard.press("2")
    expect(visit["[data-appearance=points]"]).to_have_attribute("aria-pressed", "true", timeout=PATIENCE)
    visit["#message-close"].click()


PHOTOGRAPH = """async (camera) => {
    const load = (name) => import(new URL(`page/${name}.js`, document.baseURI));
    const [{ Renderer }, { fetchScene }] = await Promise.all(["drawing/renderer", "formats/scene_file"].map(load));
    const { scene } = await (await fetch("viewer.json")).json();
    const { width, height } = camera;
    const request = GPUAdapter.prototype.requestDevice;
    let device;
    GPUAdapter.prototype.requestDevice = async function (...given) {
        return (device = await request.apply(this, given));
    };
    const renderer = await Renderer.open(Object.assign(document.createElement("canvas"), { width, height }));
    GPUAdapter.prototype.requestDevice = request;
    await renderer.setScene(await fetchScene(scene, () => {}, () => {}));
    const picture = { camera, isSharp: true, background: [0.1, 0.2, 0.3], asDepth: false };
    // Nothing is known of this GPU yet, so it draws the first image in parts.
    const [first] = await Promise.all([renderer.photograph(picture), renderer.draw(picture)]);
    const photographs = [first, await renderer.photograph(picture)];
    // Chromium 156 may hang if it collects a second device as garbage while the page draws.
    device.destroy();
    return Promise.all(photographs.map(async (blob) => Array.from(new Uint8Array(await blob.arrayBuffer()))));
}"""


def test_a_photograph_is_complete_while_frames_wait(visit: Visit, cameras: list[Camera]) -> None:
    found: Any = visit.page.evaluate(PHOTOGRAPH, described(cameras[2]))
    first, again = found
    assert first == again


def test_background(visit: Visit, engine: CpuEngine, cameras: list[Camera]) -> None:
    seen = []
    for _ in range(3):
        visit["#background"].click()
        seen.append(visit.picture())
    for grey in (0.0, 0.5, 1.0):
        expected = np.clip(engine.render(cameras[1], (grey, grey, grey)).image, 0, 1)
        assert max(psnr(picture, expected) for picture in seen) > 40


def test_compare_lays_the_photograph_over_its_part_of_the_canvas(visit: Visit) -> None:
    visit.page.set_viewport_size({"width": 600, "height": 300})
    visit["#compare-button"].click()
    box = visit["#photo"].bounding_box()
    assert box
    assert (box["x"], box["y"], box["width"], box["height"]) == pytest.approx((100, 0, WIDTH, HEIGHT), abs=1)
    slider = visit["#share"]
    for share in (0.25, 0.75):
        slider.fill(str(100 * share))
        divider = visit["#divider"].bounding_box()
        assert divider
        assert divider["x"] + 1 == pytest.approx(100 + share * WIDTH, abs=1.5)
        clip = visit["#photo"].evaluate("photo => getComputedStyle(photo).clipPath")
        assert clip == f"inset(0px {100 - 100 * share:g}% 0px 0px)"
    visit.page.keyboard.press("c")
    expect(visit["#compare"]).to_be_hidden()
    visit.page.set_viewport_size({"width": WIDTH, "height": HEIGHT})


def test_compare_shows_what_moved_in_a_training_photograph(visit: Visit) -> None:
    visit["#compare-button"].click()
    expect(visit["#camera-name"]).to_have_text("1.jpg, held out")
    visit["#next"].click()
    expect(visit["#camera-name"]).to_have_text("0.jpg, red: moved, left out")
    expect(visit["#photo"]).to_have_attribute("src", "transients/0.png")
    expect(visit["#photo"]).not_to_have_js_property("naturalWidth", 0)
    visit["#next"].click()
    expect(visit["#camera-name"]).to_have_text("1.jpg, held out")
    visit.page.keyboard.press("c")


def test_help(visit: Visit) -> None:
    visit.page.set_viewport_size({"width": 740, "height": 340})
    visit.page.keyboard.press("?")
    expect(visit["#help"]).to_be_visible()
    assert visit["#help"].evaluate("help => [help.scrollHeight > help.clientHeight, help.scrollTop]") == [True, 0]
    visit.page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    visit.page.keyboard.press("Escape")
    expect(visit["#help"]).to_be_hidden()


@pytest.mark.parametrize(("width", "finger"), [(360, 44), (320, 40)])
def test_phone_has_all_buttons_within_reach(visit: Visit, width: int, finger: int) -> None:
    visit.page.set_viewport_size({"width": width, "height": 740})
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= width
    buttons = visit["#toolbar button:visible"].all()
    assert len(buttons) >= 12
    for button in buttons:
        box = button.bounding_box()
        assert box
        assert min(box["width"], box["height"]) >= finger, button
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert box["y"] > 740 / 2
        assert box["y"] + box["height"] <= 740
    visit.page.set_viewport_size({"width": WIDTH, "height": HEIGHT})


SUBMISSIONS = """{
    // By this clock, even a busy machine draws whole images.
    const now = performance.now.bind(performance);
    performance.now = () => now() / 20;
    const own = GPUDevice.prototype.createCommandEncoder;
    self.submissions = [];
    GPUDevice.prototype.createCommandEncoder = function (options) {
        self.submissions.push(options?.label);
        return own.call(this, options);
    };
}"""


def first_drawing(visit: Visit) -> str:
    """Whether the first image since `submissions` were cleared was drawn whole or in parts, by its label."""
    return next(label for label in visit.page.evaluate("submissions") if label in ("render", "list splats"))


def test_another_pace_begins_with_small_submissions(
    browser: Browser, url: str, scene: Gaussians, tmp_path: Path
) -> None:
    """That of a much larger scene, and of another appearance, whatever the last images took."""
    larger = tmp_path / "larger.ply"
    ply.write_gaussians(larger, scene.select(np.tile(np.arange(len(scene)), 3)))
    with visiting(browser, url, WIDTH, HEIGHT, SUBMISSIONS) as visit:
        visit.until_drawn()
        visit.page.evaluate("self.submissions = []")
        visit.drop(larger.name, larger.read_bytes())
        expect(visit["#stats"]).to_contain_text(f"{3 * len(scene)} splats", timeout=PATIENCE)
        assert first_drawing(visit) == "list splats"
        visit.until_drawn()
        visit.page.evaluate("self.submissions = []")
        visit.page.keyboard.press("2")
        visit["[data-appearance=points][aria-pressed=true]"].wait_for(timeout=PATIENCE)
        visit.until_drawn()
        assert first_drawing(visit) == "list splats"
        assert visit.complaints == []


WRITERS = {".ply": ply.write_gaussians, ".splat": splat.write_gaussians, ".spz": spz.write_gaussians}


def test_scenes_that_were_trained_with_antialiasing_say_so(replaced: Visit, scene: Gaussians, tmp_path: Path) -> None:
    few = scene.select(np.arange(len(scene) - len(MARKS), len(scene)))
    plain = {}
    for suffix, write in WRITERS.items():
        write(tmp_path / f"plain{suffix}", few)
        plain[suffix] = (tmp_path / f"plain{suffix}").read_bytes()
    flagged = bytearray(plain[".spz"])
    flagged[14] |= 1
    after_element = plain[".ply"].index(b"element")

    def commented(*comments: bytes) -> bytes:
        lines = b"".join(b"comment " + comment + b"\n" for comment in comments)
        return plain[".ply"][:after_element] + lines + plain[".ply"][after_element:]

    files = {
        "mip.ply": (commented(b"SplatRenderMode: mip"), True),
        "postshot.ply": (commented(b"antialiased 1"), True),
        "last.ply": (commented(b"antialiased 1", b"SplatRenderMode:default"), False),
        "words.ply": (commented(b"antialiased 1 or 0"), False),
        "flagged.spz": (bytes(flagged), True),
        "plain.spz": (plain[".spz"], False),
    }
    for name, (content, marked) in files.items():
        replaced.drop(name, content)
        expect(replaced["#title"]).to_have_text(name, timeout=PATIENCE)
        if marked:
            expect(replaced["#message-text"]).to_contain_text(f"{name}: trained with anti-aliasing")
        else:
            expect(replaced["#message"]).to_be_hidden()
    assert replaced.complaints == []


def test_dropped_files_are_shown(replaced: Visit, scene: Gaussians, tmp_path: Path) -> None:
    few = scene.select(np.arange(len(scene) - len(MARKS), len(scene)))
    for suffix, write in WRITERS.items():
        path = tmp_path / f"dropped{suffix}"
        write(path, few)
        replaced.drop(path.name, path.read_bytes())
        expect(replaced["#title"]).to_have_text(path.name, timeout=PATIENCE)
        assert set(marks(replaced.picture())) == set(MARKS)
        expect(replaced["#stats"]).to_contain_text("3 splats")
        expect(replaced["#next"]).to_be_disabled()
    broken = tmp_path / "dropped.ply"
    replaced.drop("broken.ply", broken.read_bytes()[:-1])
    expect(replaced["#message-text"]).to_contain_text("broken.ply: the file is cut short")
    expect(replaced["#title"]).to_have_text("dropped.spz")
    replaced["#message-close"].click()
    with replaced.page.expect_file_chooser() as chooser:
        replaced["#open"].click()
    assert chooser.value.element.get_attribute("accept") is None  # iPhones know no type for scenes
    chooser.value.set_files(broken)
    expect(replaced["#title"]).to_have_text("dropped.ply")
    assert replaced.page.title() == "dropped.ply – PocketGS"
    with replaced.page.expect_download() as download:
        replaced["#screenshot"].click()
    assert download.value.suggested_filename == "dropped.ply.png"
    assert replaced.complaints == []
