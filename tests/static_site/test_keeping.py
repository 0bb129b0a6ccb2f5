"""The run, the GPU and the screen while the page trains, and afterwards."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, FilePayload, Page, expect

from pocketgs.site.write import write_site
from static_site.hosting import Host, hosting, prefix_worker
from static_site.versions import another_page
from viewer.browsing import PATIENCE, visiting
from zip_files import zip_of

Call = Callable[..., Any]

KEEP = """
    // A folder of the browser's storage that holds so many bytes, those of files that are being written included.
    const [files, open] = [new Map(), new Set()];
    const bytes = () => [...files.values(), ...open].reduce((sum, parts) => sum + sizeOf(parts), 0);
    const sizeOf = (parts) => parts.reduce((sum, part) => sum + (part.byteLength ?? part.length), 0);
    const folder = {
        removeEntry: async (name) => files.delete(name),
        getFileHandle: async (name, {create = false} = {}) => {
            if (!files.has(name) && !create) {
                throw new DOMException(name, "NotFoundError");
            }
            files.set(name, files.get(name) ?? []);
            const createWritable = async () => {
                const parts = [];
                open.add(parts);
                const write = async (part) => {
                    if (bytes() + sizeOf([part]) > given) {
                        throw new DOMException("full", "QuotaExceededError");
                    }
                    parts.push(part);
                };
                const abort = async () => open.delete(parts);
                const close = async () => open.delete(parts) && files.set(name, parts);
                return {write, abort, close};
            };
            return {createWritable, getFile: async () => new Blob(files.get(name))};
        },
    };
    const kept = new module.KeptRun(folder);
    const captureOf = (pixels) => {
        const rgba = new Uint8ClampedArray(4 * pixels);
        return {train: [{name: "a", camera: {width: pixels, height: 1}, rgba}], heldOut: [], background: [0, 0, 0]};
    };
    const checkpointOf = (losses, size) => {
        return {header: {losses: Array(losses).fill(0)}, arrays: [new Float32Array(size)]};
    };
    const tried = (work) => work.then(() => "kept", ({message}) => message);
    const told = [];
    const tell = async (work) => {
        told.push([await tried(work), (await kept.summary())?.iteration ?? null, open.size]);
    };
    await tell(kept.begin("first", captureOf(1000), {iterations: 9}));
    await tell(kept.keep(checkpointOf(1, 10)));
    // There is no room for both.
    await tell(kept.begin("second", captureOf(1500), {iterations: 9}));
    await tell(kept.keep(checkpointOf(2, 10)));
    await tell(kept.keep(checkpointOf(3, 5000)));
    await tell(kept.begin("third", captureOf(5000), {iterations: 9}));
    return [told, bytes()];
"""


def test_a_run_takes_the_place_of_the_one_before(call: Call) -> None:
    told, left = call("storage/kept_run.js", KEEP, 10_000)
    assert told == [
        ["kept", None, 0],
        ["kept", 1, 0],
        ["kept", None, 0],
        ["kept", 2, 0],
        ["full", 2, 0],
        ["full", None, 0],
    ]
    assert left == 0


TOLD_FIRST = """async () => {
    const worker = new Worker(new URL("worker.js", location.href), { type: "module" });
    const told = [];
    await new Promise((resolve) => {
        worker.addEventListener("message", ({ data: { type } }) => type === "settings" ? resolve() : told.push(type));
    });
    worker.terminate();
    return told;
}"""


def test_the_kept_run_is_known_before_anything_can_begin(modules: Page) -> None:
    """A capture that was dropped early begins with the settings, and must not take its place unasked."""
    assert "kept" in modules.evaluate(TOLD_FIRST)


BEGIN = """async (version) => {
    const { KeptRun } = await import(new URL("storage/kept_run.js", document.querySelector("script").src));
    const root = await navigator.storage.getDirectory();
    const kept = new KeptRun(await root.getDirectoryHandle("run", { create: true }), version);
    await kept.begin("toys", { train: [], heldOut: [], background: [0, 0, 0] }, { iterations: 9 });
    const header = { losses: [1, 1], count: 3, coefficients: 1 };
    await kept.keep({ header, arrays: [new Float32Array(9), new Float32Array(9)] });
}"""


def test_a_run_of_an_older_site_shows_once_the_other_tab_is_closed(browser: Browser, host: Host) -> None:
    with browser.new_context() as context:
        first = context.new_page()
        first.goto(host.address)
        first.locator("#start").wait_for(timeout=PATIENCE)
        first.evaluate(BEGIN, "an older site")
        second = context.new_page()
        second.goto(host.address)
        expect(second.locator("#message-text")).to_contain_text("Another tab of this page", timeout=PATIENCE)
        second.locator("#start").wait_for(timeout=PATIENCE)
        expect(second.locator("#go-on")).to_be_hidden()
        first.close()
        # Its scene is there, but this site does not go on with the run of another version.
        expect(second.locator("#go-on")).to_have_text("Open toys, 2 of 9", timeout=PATIENCE)
        expect(second.locator("#changed")).to_contain_text("This page has changed since")
        second.locator("#message-close").click()
        second.locator("#go-on").click()
        with second.expect_download(timeout=PATIENCE) as saved:
            second.locator("#save-ply").click(timeout=PATIENCE)
        assert b"element vertex 3\n" in Path(saved.value.path()).read_bytes()[:200]


WAIT_FOR_DEVICE = """
const request = GPUAdapter.prototype.requestDevice;
const told = new Promise((resolve) => (new BroadcastChannel("device").onmessage = resolve));
GPUAdapter.prototype.requestDevice = async function (...given) {
    await told;
    return request.apply(this, given);
};
"""
"""Runs before the page's worker: it has no GPU until it is told so."""

NAME = """async () => {
    const folder = await (await navigator.storage.getDirectory()).getDirectoryHandle("run");
    return JSON.parse(await (await (await folder.getFileHandle("capture.json")).getFile()).text()).name;
}"""


def test_a_run_that_began_beside_another_tab_does_not_replace_what_that_kept(
    browser: Browser, host: Host, capture_folder: Path
) -> None:
    """Nobody was asked about it, since it was not known when the run began."""
    with browser.new_context() as context:
        first, second = context.new_page(), context.new_page()
        first.goto(host.address)
        first.locator("#start").wait_for(timeout=PATIENCE)
        first.evaluate(BEGIN, "this site")
        prefix_worker(context, WAIT_FOR_DEVICE)
        second.goto(host.address)
        expect(second.locator("#message-text")).to_contain_text("Another tab of this page", timeout=PATIENCE)
        second.locator("#start").wait_for(timeout=PATIENCE)
        for name, value in {"most": 32, "iterations": 1, "gaussians": 100}.items():
            second.locator(f"#{name}").fill(str(value))
        second.locator("#depth").uncheck()
        files = {path.relative_to(capture_folder).as_posix(): path.read_bytes() for path in capture_folder.rglob("*.*")}
        archive = FilePayload(name="new.zip", mimeType="application/zip", buffer=zip_of(files))
        second.locator("#archive-input").set_input_files(archive)
        expect(second.locator("#stage")).to_contain_text("opening", timeout=PATIENCE)
        first.close()
        expect(second.locator("#go-on")).to_contain_text("toys, 2 of 9", timeout=PATIENCE)
        second.evaluate("() => new BroadcastChannel('device').postMessage(null)")
        second.locator("#save-ply").wait_for(timeout=PATIENCE)
        expect(second.locator("#message-text")).to_contain_text("This run cannot be kept")
        assert second.evaluate(NAME) == "toys"


def test_a_site_that_is_written_anew(browser: Browser, tmp_path: Path) -> None:
    """A reload gives all of it, though the host lets browsers keep files, and the run from before cannot go on."""
    folder = tmp_path / "site"
    with another_page(tmp_path) as copy:
        (copy / "main.js").write_text("document.body.dataset.script = 'old';\n" + (copy / "main.js").read_text())
        write_site(folder)
    [train] = folder.glob("*/train")
    for path in folder.rglob("*"):
        os.utime(path, (0, 0))  # browsers take a file for fresh for a tenth of its age
    with hosting(folder) as host, browser.new_context() as context:
        page = context.new_page()
        page.goto(host.address)
        page.locator("#start").wait_for(timeout=PATIENCE)
        page.evaluate(BEGIN, train.parent.name)
        page.reload()
        expect(page.locator("#go-on")).to_have_text("Go on with toys, 2 of 9", timeout=PATIENCE)
        expect(page.locator("body")).to_have_attribute("data-script", "old")
        write_site(folder)
        page.reload()
        expect(page.locator("#go-on")).to_have_text("Open toys, 2 of 9", timeout=PATIENCE)
        expect(page.locator("body")).not_to_have_attribute("data-script", "old")


LOSE_EARLY = """
const request = GPUAdapter.prototype.requestDevice;
let device;
GPUAdapter.prototype.requestDevice = async function (...given) {
    return (device = await request.apply(this, given));
};
const post = self.postMessage;
self.late = null;
self.postMessage = (message) => {
    post.call(self, message);
    if (["stage", "complaint"].includes(message.type)) {
        self.late?.push(message.text);
    } else if (message.type === "fault") {
        self.late = [];
    }
    if (message.text === "comparing poses") {
        device.destroy();
    }
};
"""
"""Runs before the page's worker: its GPU is lost before it trains."""


def test_nothing_goes_on_that_was_lost_before_it_was_kept(browser: Browser, host: Host, capture_folder: Path) -> None:
    with visiting(browser, "about:blank", 1280, 720) as visit:
        prefix_worker(visit.page.context, LOSE_EARLY)
        visit.page.goto(host.address)
        visit["#start"].wait_for(timeout=PATIENCE)
        files = {path.relative_to(capture_folder).as_posix(): path.read_bytes() for path in capture_folder.rglob("*.*")}
        visit.drop("toys.zip", zip_of(files))
        sentence = re.compile("The GPU was lost: [^.]+[.] Train again, with smaller photographs[.]")
        expect(visit["#message-text"]).to_have_text(sentence, timeout=PATIENCE)
        expect(visit["#go-on"]).to_be_hidden()
        # The work that was under way says nothing more: it would speak into the next run.
        visit.page.wait_for_timeout(2000)
        assert visit.page.workers[0].evaluate("self.late") == []


CHECKPOINT = """
    const told = [];
    const fails = (text) => async () => {
        throw new Error(text);
    };
    const listener = {onCheckpoint: async (checkpoint) => told.push(checkpoint)};
    const trainer = {download: fails("full"), answer: given ? fails("lost") : async () => {}};
    const run = new module.Run(trainer, {train: [], heldOut: []}, settings, {}, listener);
    const serving = run.serve().then(() => "goes on", ({message}) => message);
    await new Promise((resolve) => setTimeout(resolve, 10));
    run.close();
    return [told, await serving];
"""


@pytest.mark.parametrize(("is_lost", "expected"), [(False, [[None], "goes on"]), (True, [[], "lost"])])
def test_a_checkpoint_that_fails_ends_only_the_run_of_a_lost_gpu(call: Call, is_lost: bool, expected: object) -> None:
    assert call("training/run.js", CHECKPOINT, is_lost) == expected


OPEN = """
    let [tries, failing] = [0, 0];
    const losing = [];
    const open = async () => {
        tries++;
        if (failing) {
            failing--;
            throw new Error("no GPU");
        }
        return {number: tries, lost: new Promise((resolve) => losing.push(resolve))};
    };
    const told = [];
    const until = async (text) => {
        while (!told.includes(text)) {
            await new Promise((resolve) => setTimeout(resolve, 20));
        }
        return told.splice(0);
    };
    const tell = (text) => told.push(`${text}, ${tries}`);
    failing = 1;
    const opening = new module.GpuOpening(open, () => tell("open"), ({message}) => tell(message));
    const found = [await until("no GPU, 1"), (await opening.get()).number, await until("open, 2")];
    failing = 2;
    losing.at(-1)();
    found.push(await until("open, 5"));
    failing = 3;
    losing.at(-1)();
    found.push(await until("no GPU, 8"), (await opening.get()).number);
    return found;
"""


def test_a_lost_gpu_is_opened_again(call: Call) -> None:
    """Also when the browser needs a while for it, and when it has taken longer than the page waits."""
    expected = [["no GPU, 1"], 2, ["open, 2"], ["open, 5"], ["no GPU, 8"], 9]
    assert call("gpu_opening.js", OPEN) == expected


AWAKE = """
    const locks = [];
    let answer = [];
    const request = () => new Promise((resolve) => answer.push(() => {
        const lock = {released: false, release: async () => (lock.released = true)};
        locks.push(lock);
        resolve(lock);
    }));
    Object.defineProperty(navigator, "wakeLock", {value: {request}, configurable: true});
    const pass = () => new Promise((resolve) => setTimeout(resolve, 10));
    const answered = async () => {
        await pass();
        answer.splice(0).forEach((one) => one());
        await pass();
    };
    const held = () => locks.filter(({released}) => !released).length;
    const found = [];
    module.keepAwake(true);
    await pass();
    module.keepAwake(false);
    await answered();
    found.push(held());
    module.keepAwake(true);
    document.dispatchEvent(new Event("visibilitychange"));
    await answered();
    await answered();
    found.push(held());
    module.keepAwake(false);
    await answered();
    found.push(held());
    delete navigator.wakeLock;
    return found;
"""


def test_the_screen_is_released_however_late_its_lock_comes(call: Call) -> None:
    assert call("controls/wake_lock.js", AWAKE) == [0, 1, 0]
