"""A capture is dropped on the page, trains there, and comes out as Python would have trained it."""

from __future__ import annotations

import gzip
import io
import json
import re
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, expect

from capture.phone_layouts import in_order
from pocketgs.capture import Capture
from pocketgs.capture.colmap_export import export_capture
from pocketgs.capture.open import open_capture
from pocketgs.cli import main
from pocketgs.metrics.evaluation import psnr
from pocketgs.prior.prior import build_prior
from pocketgs.scene.formats.pgs import decode
from pocketgs.scene.formats.pgs import encode as encode_pgs
from pocketgs.scene.formats.ply import read_gaussians
from pocketgs.scene.formats.spz import encode
from pocketgs.site.settings import PGS_CODING
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rendering import render_frame
from pocketgs.training.train import train
from static_site.given import WITHOUT_FEATURES
from static_site.hosting import Host, prefix_worker
from static_site.videos import write_h264
from viewer.browsing import PATIENCE, Visit, visiting

TOLERANCE = 0.2
"""dB."""

PICTURE = "() => document.getElementById('picture').toDataURL()"

HOLD_DEVICE = """
const request = GPUAdapter.prototype.requestDevice;
GPUAdapter.prototype.requestDevice = async function (...given) {
    return (self.device = await request.apply(this, given));
};
"""


@pytest.fixture(scope="module")
def visit(browser: Browser, host: Host) -> Iterator[Visit]:
    """The page, loaded, its shaders compiled. Tests use it one after the other, as people may."""
    with visiting(browser, "about:blank", 720, 420) as visit:
        prefix_worker(visit.page.context, HOLD_DEVICE)
        # Whether to leave while it trains, and whether another run may take the place of one that is not saved.
        visit.page.on("dialog", lambda dialog: dialog.accept())
        visit.page.goto(host.address)
        visit["body[data-gpu=ready]"].wait_for(timeout=PATIENCE)
        yield visit


def choose(visit: Visit, depth: bool = False, refines: bool = False, **options: int) -> None:
    """Set the page's options."""
    if visit["#another"].is_visible():
        visit["#another"].click()
    visit["#depth"].set_checked(depth)
    expect(visit["#refines"]).to_be_enabled(enabled=depth)
    if depth:
        visit["#refines"].set_checked(refines)
    for name, value in options.items():
        visit[f"#{name}"].fill(str(value))


def zipped(folder: Path) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            archive.write(path, Path(folder.name) / path.relative_to(folder))
    return stream.getvalue()


def saved(visit: Visit, path: Path) -> Path:
    """The scene in the format of the path's suffix, once it is trained."""
    button = visit[f"#save-{path.suffix.removeprefix('.')}"]
    button.wait_for(timeout=PATIENCE)
    with visit.page.expect_download() as download:
        button.click()
    download.value.save_as(path)
    return path


def planned(visit: Visit) -> tuple[int, int]:
    """Megabytes that the page said it would take, in all and in buffers of the GPU."""
    numbers = re.match(r"Takes about ([\d,]+) MB, ([\d,]+) MB of it", visit["#plan"].inner_text())
    assert numbers, visit["#plan"].inner_text()
    total, buffers = (int(number.replace(",", "")) for number in numbers.groups())
    return total, buffers


def shown_memory(visit: Visit) -> int:
    """Megabytes of the buffers that there are; a run frees none of its own."""
    return int(visit["#memory"].inner_text().removesuffix(" MB"))


def held_out_psnr(scene: Path, capture: Path, *options: str) -> float:
    metrics = scene.parent / f"{scene.name}.metrics.json"
    main(["eval", str(scene), str(capture), "--json", str(metrics), "--engine", "cpu", *options])
    return float(json.loads(metrics.read_text())["psnr"])


def psnr_in_python(capture: Path, folder: Path, *options: str) -> float:
    """On the held-out views, of a run that does nothing that the page does not: neither poses nor things that move."""
    same = ["--effort", "quick", "--prior", "none", "--transients", "keep", "--engine", "cpu", "--evaluate-every", "0"]
    main(["train", str(capture), "--output", str(folder), *same, *options])
    return float(json.loads((folder / "run.json").read_text())["psnr"])


def picture(visit: Visit) -> str:
    """The page's image of the scene."""
    return str(visit.page.evaluate(PICTURE))


def until_turned(visit: Visit, before: str) -> None:
    """Wait for another picture, by asking: the page's policy forbids Playwright's own way."""
    deadline = time.monotonic() + PATIENCE / 1000
    while picture(visit) == before:
        assert time.monotonic() < deadline
        visit.page.wait_for_timeout(100)


def until_still(visit: Visit) -> str:
    """Wait until the picture does not get sharper any more."""
    deadline, before = time.monotonic() + PATIENCE / 1000, ""
    while picture(visit) != before:
        assert time.monotonic() < deadline
        before = picture(visit)
        visit.page.wait_for_timeout(1000)
    return before


COUNT_PICTURES = """() => {
    const post = Worker.prototype.postMessage;
    self.pictures = 0;
    Worker.prototype.postMessage = function (message, ...given) {
        self.pictures += Number(message.type === "look");
        return post.call(this, message, ...given);
    };
}"""


def cancel_after(visit: Visit, message: str) -> None:
    """Let the worker find that the user has cancelled, once, after it has told something."""
    visit.page.workers[0].evaluate(
        """(message) => {
            const post = self.postMessage;
            self.postMessage = (data) => {
                post.call(self, data);
                if (data.type === message) {
                    self.postMessage = post;
                    self.dispatchEvent(new MessageEvent("message", { data: { type: "cancel" } }));
                }
            };
        }""",
        message,
    )


def shown_psnr(visit: Visit) -> float:
    return float(visit["#psnr"].inner_text().removesuffix(" dB"))


def test_a_dropped_zip_trains_as_in_python(visit: Visit, host: Host, capture_folder: Path, tmp_path: Path) -> None:
    choose(visit, most=48, iterations=24, gaussians=1000)
    loaded = list(host.asked)
    requests: list[str] = []
    visit.page.on("request", lambda request: requests.append(request.url))
    visit.drop("toys.zip", zipped(capture_folder))
    scene = saved(visit, tmp_path / "toys.ply")
    expect(visit["#title"]).to_have_text("toys")
    total, buffers = planned(visit)
    assert shown_memory(visit) <= buffers < total < 200
    assert visit["#plan"].inner_text().endswith("GPU.")
    packed = saved(visit, tmp_path / "toys.spz")
    main(["info", str(packed)])
    expected_bytes = encode(read_gaussians(scene), version=3)
    alike = np.frombuffer(gzip.decompress(packed.read_bytes()), np.uint8) == np.frombuffer(
        gzip.decompress(expected_bytes), np.uint8
    )
    assert np.mean(alike) > 0.9999
    stored, rounded = (
        decode(saved(visit, tmp_path / "toys.pgs").read_bytes()),
        encode_pgs(read_gaussians(scene), PGS_CODING),
    )
    np.testing.assert_allclose(stored.means, decode(rounded).means)
    np.testing.assert_allclose(stored.sh, decode(rounded).sh)
    # Blobs are of the page itself; the network is asked for nothing.
    assert [url for url in requests if not url.startswith("blob:")] == []
    assert host.asked == loaded
    assert visit.complaints == []
    size = ("--max-size", "48")
    found = held_out_psnr(scene, capture_folder, *size)
    assert shown_psnr(visit) == pytest.approx(found, abs=0.02)
    expected, less = (
        psnr_in_python(capture_folder, tmp_path / count, "--iterations", count, "--max-gaussians", "1000", *size)
        for count in ("24", "6")
    )
    assert abs(found - expected) < TOLERANCE
    assert found > less + 3 * TOLERANCE


def test_paused_turned_stopped_and_kept(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    choose(visit, most=48, iterations=20_000, gaussians=300)
    visit["#folder-input"].set_input_files(capture_folder)
    visit["#pause:enabled"].click(timeout=PATIENCE)
    expect(visit["#pause"]).to_have_text("Resume")
    still = until_still(visit)
    before = visit["#iteration"].inner_text()
    visit.page.wait_for_timeout(500)
    assert visit["#iteration"].inner_text() == before
    assert picture(visit) == still
    visit["#picture"].drag_to(visit["#picture"], source_position={"x": 60, "y": 60}, target_position={"x": 90, "y": 60})
    expect(visit["#photograph"]).to_be_hidden()
    until_turned(visit, still)
    visit["#beside"].click()
    expect(visit["#photograph"]).to_be_visible()
    visit["#pause"].click()
    expect(visit["#iteration"]).not_to_have_text(before)
    visit.drop("other.zip", b"")
    expect(visit["#message-text"]).to_contain_text("stop it first")
    visit["#message-close"].click()
    visit["#stop"].click()
    scene = saved(visit, tmp_path / "scene.ply")
    assert int(visit["#iteration"].inner_text().split(" / ")[0]) < 20_000
    assert b"element vertex 300\n" in scene.read_bytes()[:200]
    assert visit.complaints == []


def test_a_broken_capture_leaves_the_page_usable(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    visit.drop("broken.zip", zipped(capture_folder)[:2000])
    expect(visit["#message-text"]).to_contain_text("broken.zip: is no zip file, or cut short")
    whole = {image: image.read_bytes() for image in sorted((capture_folder / "images").iterdir())}
    for image, content in whole.items():
        image.write_bytes(content[:200])
    visit.drop("damaged.zip", zipped(capture_folder))
    expect(visit["#message-text"]).to_contain_text("images/0000.png: cannot be decoded", timeout=PATIENCE)
    expect(visit["#message-text"]).to_contain_text("no frame is left to train on")
    for image, content in whole.items():
        image.write_bytes(content)
    choose(visit, most=32, iterations=1, gaussians=100)
    visit.drop("sound.zip", zipped(capture_folder))
    assert b"element vertex 100\n" in saved(visit, tmp_path / "scene.ply").read_bytes()[:200]
    assert visit.complaints == []


def test_a_folder_that_cannot_be_read(visit: Visit) -> None:
    visit.page.evaluate(
        """() => {
            const readEntries = (_, refuse) => refuse(new DOMException("it has gone", "NotFoundError"));
            const folder = { isDirectory: true, createReader: () => ({ readEntries }) };
            const dataTransfer = { items: [{ webkitGetAsEntry: () => folder }], files: [] };
            window.dispatchEvent(Object.assign(new Event("drop"), { dataTransfer }));
        }"""
    )
    expect(visit["#message-text"]).to_have_text("What was dropped cannot be read: it has gone")
    visit["#message-close"].click()
    assert visit.complaints == []


def paused_and_kept(visit: Visit) -> int:
    """Pause the run, and wait until it is kept as it stands. Returns how many iterations that are."""
    visit["#pause:enabled"].click(timeout=PATIENCE)
    deadline = time.monotonic() + PATIENCE / 1000
    while True:
        visit.page.wait_for_timeout(300)
        done, end = visit["#iteration"].inner_text().split(" / ")
        if visit["#go-on"].text_content() == f"Go on with toys, {done} of {end}":
            return int(done)
        assert time.monotonic() < deadline


def test_a_run_goes_on_after_the_page_was_closed(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    """To the same bits as without the break."""
    choose(visit, most=32, iterations=24, gaussians=200)
    visit.drop("toys.zip", zipped(capture_folder))
    done = paused_and_kept(visit)
    visit.page.reload()
    visit["#go-on"].wait_for(timeout=PATIENCE)
    expect(visit["#go-on"]).to_have_text(f"Go on with toys, {done} of 24")
    visit["#go-on"].click()
    interrupted = saved(visit, tmp_path / "interrupted.ply").read_bytes()
    choose(visit, most=32, iterations=24, gaussians=200)
    visit.drop("toys.zip", zipped(capture_folder))
    assert saved(visit, tmp_path / "whole.ply").read_bytes() == interrupted
    assert 0 < done < 24
    assert visit.complaints == []


@pytest.mark.parametrize("name", ["stray-scanner", "polycam"])
def test_recordings_of_apps(
    visit: Visit, small_capture: Capture, copied_phone: Callable[[str], Path], tmp_path: Path, name: str
) -> None:
    """A video is decoded, a border cut off, and masks are used, as in Python."""
    folder = copied_phone(name)
    if name == "stray-scanner":
        write_h264(folder / "rgb.mp4", [frame.image for frame in in_order(small_capture)])
    else:
        photographs = sorted((folder / "keyframes" / "corrected_images").iterdir())
        (folder / "keyframes" / "masks").mkdir()
        mask = Image.fromarray(np.uint8(255 * (np.arange(96) > 40))[None].repeat(72, axis=0))
        for path in photographs:
            mask.save(folder / "keyframes" / "masks" / f"{path.stem}.png")
    choose(visit, most=48, iterations=20, gaussians=800)
    visit.drop("recording.zip", zipped(folder))
    scene = saved(visit, tmp_path / "recording.ply")
    assert shown_memory(visit) <= planned(visit)[1]
    assert visit.complaints == []
    size = ("--max-size", "48")
    found = held_out_psnr(scene, folder, *size)
    # A video's colours are rounded differently.
    assert shown_psnr(visit) == pytest.approx(found, abs=0.15 if name == "stray-scanner" else 0.02)
    psnr_in_python(folder, tmp_path / "python", "--iterations", "20", "--max-gaussians", "800", *size)
    capture = open_capture(folder, max_size=48)
    assert abs(mean_psnr(scene, capture) - mean_psnr(tmp_path / "python" / "scene.ply", capture)) < TOLERANCE


def test_measured_depth(visit: Visit, copied_phone: Callable[[str], Path], tmp_path: Path) -> None:
    """A recording with depth of the sensor, which the prior uses as Python's does. Its photographs are too small for
    features.
    """
    folder = copied_phone("record3d")
    choose(visit, depth=True, refines=True, most=48, iterations=12, gaussians=800)
    visit.drop("recording.r3d", zipped(folder))
    scene = saved(visit, tmp_path / "recording.ply")
    expect(visit["#message-text"]).to_have_text(
        "The photographs have too few features in common: poses stay as they are."
    )
    visit["#message-close"].click()
    assert visit.complaints == []
    expected = trained_with_depth(folder, tmp_path / "python.ply", max_size=48, iterations=12, gaussians=800)
    capture = open_capture(folder, max_size=48)
    assert abs(mean_psnr(scene, capture) - mean_psnr(expected, capture)) < TOLERANCE


def mean_psnr(scene: Path, capture: Capture) -> float:
    """Over all photographs: of eight one is held out, and one says little."""
    engine, black = CpuEngine(), (0.0, 0.0, 0.0)
    engine.upload(read_gaussians(scene))
    images = [render_frame(engine, frame, black) for frame in capture.frames]
    pairs = zip(images, capture.frames, strict=True)
    return float(np.mean([psnr(image, frame.image / 255.0, frame.mask) for image, frame in pairs]))


def trained_with_depth(capture: Path, path: Path, max_size: int, iterations: int, gaussians: int) -> Path:
    """The scene of a run in Python that starts from the page's prior."""
    prepared = build_prior(open_capture(capture, max_size=max_size), gaussians, WITHOUT_FEATURES)
    sizes: dict[str, object] = {"iterations": iterations, "max_gaussians": gaussians}
    train(prepared, effort="quick", transients="keep", engine="cpu", evaluate_every=0, **sizes).scene.save(path)
    return path


def test_what_does_not_fit_is_reduced_or_refused(visit: Visit, capture_folder: Path) -> None:
    choose(visit, most=64, iterations=1, gaussians=40_000, budget=50)
    visit.drop("toys.zip", zipped(capture_folder))
    visit["#save-ply"].wait_for(timeout=PATIENCE)
    total, buffers = planned(visit)
    assert shown_memory(visit) <= buffers < total <= 50
    assert "Reduced splats to" in visit["#plan"].inner_text()
    assert "photographs of 64 pixels and 40,000 splats would take" in visit["#plan"].inner_text()
    stream = io.BytesIO()
    Image.new("RGB", (2880, 2160)).save(stream, "png")
    for image in (capture_folder / "images").iterdir():
        image.write_bytes(stream.getvalue())
    choose(visit, most=64, iterations=1, gaussians=20_000, budget=50)
    visit.drop("huge.zip", zipped(capture_folder))
    expect(visit["#message-text"]).to_contain_text("would take 100 MB, more than 50 MB", timeout=PATIENCE)
    visit["#message-close"].click()
    choose(visit, budget=1000)
    assert visit.complaints == []


def test_phones_are_asked_where_to_share(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    choose(visit, most=32, iterations=1, gaussians=100)
    visit.drop("toys.zip", zipped(capture_folder))
    visit["#save-spz"].wait_for(timeout=PATIENCE)
    visit.page.evaluate(
        """() => {
            navigator.canShare = ({files}) => files.length === 1;
            navigator.share = async ({files}) => {
                self.shared = files[0].name;
                throw new DOMException("", self.refusal ?? "AbortError");
            };
        }"""
    )
    visit["#save-spz"].click()
    assert visit.page.evaluate("self.shared") == "toys.spz"
    visit.page.evaluate("self.refusal = 'NotAllowedError'")
    assert saved(visit, tmp_path / "toys.ply").read_bytes().startswith(b"ply")
    assert visit.page.evaluate("self.shared") == "toys.ply"
    visit.page.evaluate("() => { delete navigator.canShare; delete navigator.share; }")
    assert visit.complaints == []


def test_a_browser_without_webgpu_is_told_so(browser: Browser, host: Host) -> None:
    with browser.new_context() as context:
        prefix_worker(context, "delete WorkerNavigator.prototype.gpu;")
        page = context.new_page()
        page.goto(host.address)
        expect(page.locator("#message-text")).to_contain_text("no WebGPU: expected a browser that supports it")


def test_fern_with_depth(visit: Visit, data_folder: Path, tmp_path: Path) -> None:
    """A real capture, whose lens is undone by Python first: LLFF states it in a file that the page does not read."""
    folder = tmp_path / "fern"
    capture = open_capture(data_folder / "fern", images="images_8", max_size=96)
    export_capture(folder, replace(capture, train=capture.train[:4]))
    size = ("--max-size", "48")
    choose(visit, depth=True, most=48, iterations=20, gaussians=1000)
    visit.drop("fern.zip", zipped(folder))
    expect(visit["#stage"]).to_have_text(re.compile(r"depth of keyframe \d of 6"), timeout=PATIENCE)
    scene = saved(visit, tmp_path / "fern.ply")
    assert visit.complaints == []
    found = held_out_psnr(scene, folder, *size)
    expected = trained_with_depth(folder, tmp_path / "python.ply", max_size=48, iterations=20, gaussians=1000)
    assert abs(found - held_out_psnr(expected, folder, *size)) < TOLERANCE


def test_depth_can_be_cancelled(visit: Visit, capture_folder: Path) -> None:
    choose(visit, depth=True, most=64, iterations=10)
    visit.drop("toys.zip", zipped(capture_folder))
    expect(visit["#stage"]).to_contain_text("depth of keyframe", timeout=PATIENCE)
    expect(visit["#stop"]).to_be_hidden()
    visit["#cancel"].click()
    visit["#start"].wait_for(timeout=PATIENCE)
    expect(visit["#live"]).to_be_hidden()
    assert visit.complaints == []


def test_training_can_be_cancelled_until_its_first_step(visit: Visit, capture_folder: Path) -> None:
    """The kept run of before is still there."""
    choose(visit, most=32, iterations=1, gaussians=100)
    visit.drop("before.zip", zipped(capture_folder))
    visit["#save-ply"].wait_for(timeout=PATIENCE)
    choose(visit, most=32, iterations=20_000, gaussians=100)
    cancel_after(visit, "first")
    visit.drop("toys.zip", zipped(capture_folder))
    visit["#live"].wait_for()
    visit["#start"].wait_for(timeout=PATIENCE)
    expect(visit["#live"]).to_be_hidden()
    expect(visit["#go-on"]).to_have_text("Go on with before, 1 of 1")
    assert visit.complaints == []


NO_ROOM = """() => {
    const [create, pop] = [device.createBuffer, device.popErrorScope];
    let isFull = false;
    device.createBuffer = (wanted) => {
        if (wanted.label !== "copy of first_moments") {
            return create.call(device, wanted);
        }
        isFull = true;
        device.pushErrorScope("validation");
        const invalid = create.call(device, { ...wanted, size: 2 ** 50 });
        pop.call(device);
        return invalid;
    };
    device.popErrorScope = async () => {
        const [found, wasFull] = [pop.call(device), isFull];
        isFull = false;
        return (await found) ?? (wasFull ? new GPUOutOfMemoryError("full") : null);
    };
}"""


def test_a_run_goes_on_where_the_gpu_has_no_room_for_a_checkpoint(
    visit: Visit, capture_folder: Path, tmp_path: Path
) -> None:
    choose(visit, most=32, iterations=2, gaussians=100)
    visit.page.workers[0].evaluate(NO_ROOM)
    visit.drop("toys.zip", zipped(capture_folder))
    scene = saved(visit, tmp_path / "scene.ply").read_bytes()
    visit.page.workers[0].evaluate("() => { delete device.createBuffer; delete device.popErrorScope; }")
    assert b"element vertex 100\n" in scene[:200]
    expect(visit["#message-text"]).to_contain_text("cannot be kept in the browser's storage")
    visit["#message-close"].click()
    assert visit.complaints == []


def test_cancelling_too_late_changes_nothing(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    choose(visit, most=32, iterations=1, gaussians=100)
    cancel_after(visit, "progress")
    visit.drop("toys.zip", zipped(capture_folder))
    assert len(decode(saved(visit, tmp_path / "scene.pgs").read_bytes())) == 100
    expect(visit["#message"]).to_be_hidden()


def test_a_trained_scene_is_drawn_only_when_it_turns(visit: Visit, capture_folder: Path) -> None:
    choose(visit, most=32, iterations=1, gaussians=100)
    visit.page.evaluate(COUNT_PICTURES)
    visit.drop("toys.zip", zipped(capture_folder))
    visit["#save-ply"].wait_for(timeout=PATIENCE)
    until_still(visit)
    drawn = visit.page.evaluate("pictures")
    visit.page.wait_for_timeout(1000)
    assert 0 < visit.page.evaluate("pictures") == drawn


def test_a_gpu_lost_at_the_end_leaves_the_scene(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    choose(visit, most=32, iterations=1, gaussians=100)
    visit.drop("toys.zip", zipped(capture_folder))
    scene = saved(visit, tmp_path / "scene.ply").read_bytes()
    visit.page.workers[0].evaluate("device.destroy()")
    expect(visit["#message-text"]).to_contain_text("The scene can be saved, but not turned", timeout=PATIENCE)
    visit["#message-close"].click()
    visit.page.evaluate(
        """() => {
            Object.defineProperty(document, "hidden", { value: true, configurable: true });
            document.dispatchEvent(new Event("visibilitychange"));
            delete document.hidden;
        }"""
    )
    visit.page.wait_for_timeout(1000)
    assert saved(visit, tmp_path / "again.ply").read_bytes() == scene
    expect(visit["#message"]).to_be_hidden()


def test_a_run_survives_a_lost_gpu(visit: Visit, capture_folder: Path, tmp_path: Path) -> None:
    choose(visit, most=32, iterations=20_000, gaussians=100)
    visit.drop("toys.zip", zipped(capture_folder))
    paused_and_kept(visit)
    visit.page.workers[0].evaluate("device.destroy()")
    expect(visit["#message-text"]).to_contain_text("The GPU was lost", timeout=PATIENCE)
    visit["#message-close"].click()
    visit["#go-on"].click()
    visit["#stop:enabled"].click(timeout=PATIENCE)
    assert b"element vertex 100\n" in saved(visit, tmp_path / "scene.ply").read_bytes()[:200]
