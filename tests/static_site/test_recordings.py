"""The page reads phone apps' recordings as Python does, the frames of a video included."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Error

from capture.phone_layouts import edit_json, in_order, with_quarter_turn, write_polycam, zip_folder
from pocketgs.capture import Capture
from pocketgs.capture.decoding.video_file import read_frames, sharpness_of_frames
from pocketgs.capture.open import read_listing
from pocketgs.capture.sharpness import sharpest_in_windows
from static_site.reading import READ, assert_same, assert_same_refusal, read
from static_site.videos import without_first, write_h264, write_hevc

Call = Callable[..., Any]

FRAMES = """
    const bytes = Uint8Array.from(atob(given.content), (character) => character.charCodeAt(0));
    const video = new module.Video("rgb.mp4", bytes);
    const found = [];
    for await (const {width, height, rgba} of video.frames(given.wanted)) {
        found.push([width, height, [...rgba]]);
    }
    return [video.count, found];
"""

FRAMES_OF_FEW = """
    // A decoder that has room for so many frames: it gives the next one when one of them is closed.
    const Roomy = VideoDecoder;
    let room = given.room;
    self.VideoDecoder = class extends Roomy {
        #ready;
        constructor({output, error}) {
            const ready = [];
            const give = () => {
                while (room && ready.length) {
                    const frame = ready.shift();
                    frame.close = () => {
                        VideoFrame.prototype.close.call(frame);
                        room += 1;
                        setTimeout(give);
                    };
                    room -= 1;
                    output(frame);
                }
            };
            super({output: (frame) => { ready.push(frame); give(); }, error});
            this.#ready = ready;
        }
        async flush() {
            await super.flush();
            while (this.#ready.length) {
                await new Promise((resolve) => setTimeout(resolve));
            }
        }
    };
    try {
        const bytes = Uint8Array.from(atob(given.content), (character) => character.charCodeAt(0));
        let count = 0;
        const decoding = (async () => {
            for await (const _ of new module.Video("rgb.mp4", bytes).frames(given.wanted)) {
                count += 1;
            }
        })();
        await Promise.race([decoding, new Promise((resolve) => setTimeout(resolve, 60_000))]);
        return [count, room];
    } finally {
        self.VideoDecoder = Roomy;
    }
"""


@pytest.fixture
def stray_scanner(small_capture: Capture, copied_phone: Callable[[str], Path]) -> Path:
    """As the app writes it but for the codec, which is HEVC there."""
    folder = copied_phone("stray-scanner")
    write_h264(folder / "rgb.mp4", [frame.image for frame in in_order(small_capture)])
    return folder


@pytest.mark.parametrize("name", ["record3d", "3d-scanner-app", "polycam", "nerfstudio"])
def test_layouts_of_apps(call: Call, written_phones: dict[str, Path], name: str) -> None:
    assert_same(call, written_phones[name])


def test_stray_scanner(call: Call, stray_scanner: Path) -> None:
    assert_same(call, stray_scanner)
    odometry = stray_scanner / "odometry.csv"
    header, *lines = odometry.read_text().splitlines()
    stated = [f"{line}, {90 + number}, 91, 47, 35, " for number, line in enumerate(lines)]
    stated[2] = f"{lines[2]}, , , , , "
    stated[3] = ",".join(f'"{word.strip()}"' for word in stated[3].split(","))
    odometry.write_text("\r\n".join([f"\ufeff{header}, fx, fy, cx, cy, more", "", *stated[::-1][:6]]))
    assert_same(call, stray_scanner)


@pytest.mark.parametrize("name", ["record3d_exr", "scanner_app_lowres", "polycam_json", "stray_csv"])
def test_real_recordings(call: Call, data_folder: Path, small_capture: Capture, tmp_path: Path, name: str) -> None:
    """Their tables, and the names of their photographs; of Polycam and Stray Scanner no pictures are at hand."""
    source = data_folder / "recordings" / name
    place = tmp_path / "keyframes" / "cameras" if name == "polycam_json" else tmp_path
    for path in (path for path in source.rglob("*") if path.is_file()):
        copy = place / path.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes() if path.suffix in ("", ".json", ".csv") else b"")
        if name == "polycam_json":
            image = tmp_path / "keyframes" / "images" / f"{path.stem}.jpg"
            image.parent.mkdir(exist_ok=True)
            image.write_bytes(b"")
    if name == "stray_csv":
        write_h264(tmp_path / "rgb.mp4", [frame.image for frame in in_order(small_capture)])
    assert_same(call, tmp_path)


def test_polycam_without_corrections_and_without_an_image(call: Call, small_capture: Capture, tmp_path: Path) -> None:
    write_polycam(small_capture, tmp_path, kind="")
    first, second, third, *_ = sorted((tmp_path / "keyframes" / "images").iterdir())
    first.unlink()
    second.rename(second.with_suffix(".jpeg"))
    third.rename(third.with_suffix(".JPEG"))
    assert_same(call, tmp_path)
    assert len(read(call, tmp_path)["frames"]) == 7


def test_polycam_with_damaged_cameras(call: Call, copied_phone: Callable[[str], Path]) -> None:
    folder = copied_phone("polycam")
    cameras = sorted((folder / "keyframes" / "corrected_cameras").iterdir())
    cameras[2].write_bytes(b"")
    assert_same(call, folder)
    assert "1 of 8 cameras are damaged, the first (" in read(call, folder)["warnings"][0]
    for camera in cameras[4:]:
        camera.write_bytes(b"{")
    assert_same_refusal(call, folder, r"\.json: not .*JSON")


def test_record3d_with_intrinsics_of_each_frame(call: Call, copied_phone: Callable[[str], Path]) -> None:
    folder = copied_phone("record3d")
    edit_json(folder / "metadata", perFrameIntrinsicCoeffs=[[80.0 + index, 90.0, 40.0, 30.0] for index in range(8)])
    (folder / "rgbd" / "3.jpg").unlink()
    assert_same(call, folder)
    (folder / "metadata").rename(folder / "metadata.json")
    (folder / "rgbd").rename(folder / "rgb")
    assert_same(call, folder)


@pytest.mark.parametrize("missing", ["dw", "dh"])
def test_record3d_without_the_size_of_depth(call: Call, copied_phone: Callable[[str], Path], missing: str) -> None:
    folder = copied_phone("record3d")
    edit_json(folder / "metadata", **{missing: None})
    assert_same(call, folder)
    assert [frame["depth"] for frame in read(call, folder)["frames"]] == [None] * 8


def test_an_apps_own_data_goes_first(
    call: Call, written_phones: dict[str, Path], copied_phone: Callable[[str], Path]
) -> None:
    folder = copied_phone("polycam")
    (folder / "transforms.json").write_bytes((written_phones["nerfstudio"] / "transforms.json").read_bytes())
    assert_same(call, folder)


@pytest.mark.parametrize("most", [3, 7])
@pytest.mark.parametrize("name", ["record3d", "stray-scanner"])
def test_the_sharpest_frames(
    call: Call, written_phones: dict[str, Path], stray_scanner: Path, name: str, most: int
) -> None:
    folder = stray_scanner if name == "stray-scanner" else written_phones[name]
    with pytest.MonkeyPatch.context() as patch:
        for module in ("record3d", "stray_scanner"):
            patch.setattr(f"pocketgs.capture.formats.{module}.MAX_FRAMES", most, raising=False)
        patch.setattr("pocketgs.capture.sharpness.sharpest_photographs.__defaults__", (most,))
        expected = [frame.name for frame in read_listing(folder).frames]
    files = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    given = {path: base64.b64encode(content).decode() for path, content in files.items()}
    found = call("capture/open.js", f"settings.capture.max_frames = {most};" + READ, given)
    assert [frame["name"] for frame in found["frames"]] == expected
    assert len(expected) == most
    assert len(found["warnings"]) == 1


@pytest.mark.parametrize(
    ("stated", "left_out"),
    [(True, 0), (True, 3), (False, 0)],
    ids=["whole", "cut at its beginning", "no colours stated"],
)
def test_frames_of_a_video_are_pythons(
    call: Call, small_capture: Capture, tmp_path: Path, stated: bool, left_out: int
) -> None:
    """With frames that refer to later ones, and a rotation that is not applied: the numbers are those of Python."""
    path = tmp_path / "rgb.mp4"
    images = [np.roll(frame.image, 3 * turn, axis=1) for turn in range(3) for frame in in_order(small_capture)]
    write_h264(path, images, states_colours=stated)
    path.write_bytes(without_first(with_quarter_turn(path.read_bytes(), images[0].shape[0]), left_out))
    wanted = [0, 1, 2, 7, 13, 19, 20]
    given = {"content": base64.b64encode(path.read_bytes()).decode(), "wanted": wanted}
    count, found = call("capture/video.js", FRAMES, given)
    assert count == len(sharpness_of_frames(path)) == len(images) - left_out
    expected = list(read_frames(path, wanted, upright=False))
    assert len(found) == len(expected)
    for (width, height, rgba), (_, image) in zip(found, expected, strict=True):
        assert (height, width) == image.shape[:2]
        off = np.abs(np.reshape(rgba, (height, width, 4))[..., :3] - image.astype(int))
        if stated:
            assert off.mean() < 2.5  # both round, and spread chroma, in their own way
            assert np.quantile(off, 0.999) <= 8
        else:  # each decoder guesses how colours are coded
            assert off.mean() < 12


def test_decoders_with_room_for_few_frames(call: Call, small_capture: Capture, tmp_path: Path) -> None:
    """As those in a phone's hardware: with all their frames open, they do not get to the end of a video."""
    path = tmp_path / "rgb.mp4"
    images = [frame.image for frame in in_order(small_capture)] * 3
    write_h264(path, images)
    given = {"content": base64.b64encode(path.read_bytes()).decode(), "wanted": [*range(len(images))], "room": 2}
    assert call("capture/video.js", FRAMES_OF_FEW, given) == [len(images), 2]


def test_a_browser_that_lacks_the_codec_is_named(call: Call, small_capture: Capture, tmp_path: Path) -> None:
    path = tmp_path / "rgb.mp4"
    write_hevc(path, [frame.image for frame in in_order(small_capture)])
    script = """
        const bytes = Uint8Array.from(atob(given), (character) => character.charCodeAt(0));
        const {codec, width, height, samples, shown} = (await import(new URL("capture/mp4.js", location.href)))
            .readTrack(bytes, "rgb.mp4");
        const {supported} = await VideoDecoder.isConfigSupported({codec});
        if (!supported) {
            const error = await new module.Video("rgb.mp4", bytes).frames([0]).next().catch(({message}) => message);
            return [codec, width, height, samples.length, shown.size, error];
        }
        return [codec, width, height, samples.length, shown.size, `codec ${codec}`];
    """
    content = base64.b64encode(path.read_bytes()).decode()
    codec, *sizes, error = call("capture/video.js", script, content)
    assert codec.startswith("hvc1.1.6.L")
    assert sizes == [96, 72, 8, 8]
    assert f"codec {codec}" in error


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda mp4: b"", "it has no part 'moov'"),
        (lambda mp4: mp4[: len(mp4) // 2], "cut short|no part 'moov'"),
        (lambda mp4: mp4.replace(b"avc1", b"mp4v"), "of the kind 'mp4v', not H.264 or HEVC"),
        (lambda mp4: mp4.replace(b"vide", b"soun"), "it has no part 'trak'"),
        (lambda mp4: mp4.replace(b"stsz", b"skip"), "it has no part 'stsz'"),
    ],
)
def test_what_is_no_video(call: Call, stray_scanner: Path, change: Callable[[bytes], bytes], words: str) -> None:
    video = stray_scanner / "rgb.mp4"
    video.write_bytes(change(video.read_bytes()))
    with pytest.raises(Error, match=rf"rgb\.mp4: .*({words}).* expected a whole MP4 file with a video"):
        read(call, stray_scanner)


def test_r3d_archives_and_parts_of_files(call: Call, written_phones: dict[str, Path], tmp_path: Path) -> None:
    archive = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    script = """
        const {FileTree} = await import(new URL("archive/tree.js", location.href));
        const {filesInZip} = await import(new URL("archive/zip.js", location.href));
        const bytes = Uint8Array.from(atob(given), (character) => character.charCodeAt(0));
        const tree = new FileTree(await filesInZip(new Blob([bytes]), "walk.r3d"));
        const [start, whole] = [await tree.find("rgbd/0.jpg").start(500), await tree.find("rgbd/0.jpg").bytes()];
        const isStart = start.length === 500 && start.every((byte, i) => byte === whole[i]);
        const listing = await module.readListing(tree, settings.capture);
        return [listing.format, listing.frames.length, isStart];
    """
    content = base64.b64encode(archive.read_bytes()).decode()
    assert call("capture/open.js", script, content) == ["record3d", 8, True]


@pytest.mark.parametrize("name", ["walk.r3d", "recordings/walk.R3D"])
def test_folders_around_one_r3d_archive(call: Call, written_phones: dict[str, Path], tmp_path: Path, name: str) -> None:
    """As AirDrop and clouds deliver it, with what systems add."""
    archive = tmp_path / "shared" / name
    archive.parent.mkdir(parents=True)
    zip_folder(written_phones["record3d"], archive)
    (archive.parent / ".DS_Store").write_bytes(b"")
    found, expected = read(call, tmp_path / "shared"), read(call, written_phones["record3d"])
    assert found == expected


def test_windows_are_numpys(call: Call) -> None:
    values = np.random.default_rng(0).integers(0, 9, 37).tolist()
    script = "return given.counts.map((count) => module.sharpestInWindows(given.values, count));"
    counts = [1, 2, 5, 36, 37, 50]
    found = call("capture/sharpness.js", script, {"values": values, "counts": counts})
    assert found == [sharpest_in_windows(values, count) for count in counts]
