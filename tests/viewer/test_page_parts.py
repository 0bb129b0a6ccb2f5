"""Parts of the page by themselves, in a browser without a GPU: the readers of files, and when it draws, how finely."""

from __future__ import annotations

import base64
import gzip
import json
import struct
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from playwright.sync_api import Error, Page
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats import pgs, ply, read_scene, splat, spz
from pocketgs.scene.formats.pgs_coding import FINE
from pocketgs.scene.formats.pgs_sections import Section, join_sections, split_sections
from pocketgs.scene.formats.spz_precision import SMALL
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.webgpu.scene_columns import to_columns
from scene.formats.scenes import write_ply_of_degree_4

READ = """async ([name, content]) => {
    const { readScene } = await import(new URL("page/formats/scene_file.js", document.baseURI));
    const bytes = Uint8Array.from(atob(content), (character) => character.charCodeAt(0));
    const shares = [];
    const scene = await readScene(name, new Blob([bytes]).stream(), bytes.length, (share) => shares.push(share));
    return JSON.stringify([scene.count, scene.coefficients, Array.from(scene.shape), Array.from(scene.sh), shares]);
}"""
Written = tuple[str, Callable[[Path, Gaussians], None], Callable[[Path], Gaussians]]
FORMATS: list[Written] = [
    ("scene.ply", ply.write_gaussians, ply.read_gaussians),
    ("scene.splat", splat.write_gaussians, splat.read_gaussians),
    ("scene.spz", lambda path, scene: spz.write_gaussians(path, scene, version=3), spz.read_gaussians),
    ("scene.spz", lambda path, scene: spz.write_gaussians(path, scene, version=4), spz.read_gaussians),
    ("scene.spz", lambda path, scene: spz.write_gaussians(path, scene, precision=SMALL), spz.read_gaussians),
    ("scene.pgs", pgs.write_gaussians, pgs.read_gaussians),
    ("scene.pgs", lambda path, scene: pgs.write_gaussians(path, scene, FINE), pgs.read_gaussians),
]
AXES = 0xADBE0003
"""The extension of a .spz that states its axes."""

written = pytest.mark.parametrize("written", FORMATS, ids=("ply", "splat", "spz3", "spz4", "small", "pgs", "fine pgs"))


def read(page: Page, name: str, content: bytes) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """The scene's columns as the page reads them, and the progress it was told of."""
    found = page.evaluate(READ, [name, base64.b64encode(content).decode()])
    count, coefficients, shape, sh, shares = json.loads(found)
    return np.reshape(shape, (11, count)), np.reshape(sh, (3 * coefficients, count)), shares


READ_PARTS = """async ([name, content]) => {
    const { readScene } = await import(new URL("page/formats/scene_file.js", document.baseURI));
    const bytes = Uint8Array.from(atob(content), (character) => character.charCodeAt(0));
    const parts = [];
    const onPart = (scene, count) => parts.push([count, Array.from(scene.column(0).subarray(0, count))]);
    await readScene(name, new Blob([bytes]).stream(), bytes.length, () => {}, onPart);
    return JSON.stringify(parts);
}"""


def random_scene(count: int, coefficients: int) -> Gaussians:
    rng = np.random.default_rng(count + coefficients)
    return Gaussians(
        rng.normal(0, 3, (count, 3)),
        rng.normal(-3, 1, (count, 3)),
        rng.normal(0, 1, (count, 4)),
        rng.normal(0, 2, count),
        rng.normal(0, 0.3, (count, coefficients, 3)),
    )


@written
@pytest.mark.parametrize(("count", "coefficients"), [(1, 1), (300, 4), (17, 9), (9000, 16)])
def test_page_reads_what_python_reads(
    page: Page, tmp_path: Path, written: Written, count: int, coefficients: int
) -> None:
    name, write, read_again = written
    path = tmp_path / name
    write(path, random_scene(count, coefficients))
    shape, sh, shares = read(page, name, path.read_bytes())
    for found, expected in zip((shape, sh), to_columns(read_again(path)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.parametrize("written", FORMATS[:2], ids=("ply", "splat"))
def test_page_shows_what_has_been_read(page: Page, tmp_path: Path, written: Written) -> None:
    """Row by row, in growing parts; the reported rows are always there."""
    name, write, read_again = written
    path = tmp_path / name
    write(path, random_scene(20_000, 1))
    parts = json.loads(page.evaluate(READ_PARTS, [name, base64.b64encode(path.read_bytes()).decode()]))
    counts = [count for count, _ in parts]
    assert len(counts) > 2
    assert counts == sorted(set(counts))
    assert counts[-1] == 20_000
    x = read_again(path).means[:, 0]
    for count, found in parts:
        np.testing.assert_array_equal(np.float32(found), x[:count])


@pytest.mark.filterwarnings("ignore:.*degree 4, which are dropped")
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("degree", [0, 3, 4])
def test_page_reads_early_spz(page: Page, tmp_path: Path, version: int, degree: int) -> None:
    rng, count = np.random.default_rng(version + degree), 50
    widths = [9, 1, 3, 3, 3, 3 * ((degree + 1) ** 2 - 1)]
    streams = [rng.integers(0, 256, count * width, dtype=np.uint8).tobytes() for width in widths]
    if version == 1:
        streams[0] = rng.normal(0, 3, (count, 3)).astype("<f2").tobytes()
    path = tmp_path / "early.spz"
    header = struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, 12, 0, 0)
    path.write_bytes(gzip.compress(header + b"".join(streams)))
    shape, sh, _ = read(page, path.name, path.read_bytes())
    for found, expected in zip((shape, sh), to_columns(spz.read_gaussians(path)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


def test_page_reads_ply_of_other_types(page: Page) -> None:
    """Doubles, bytes, properties of no use, and big-endian numbers."""
    names = ["x", "y", "z", *(f"f_dc_{i}" for i in range(3)), "opacity", *(f"scale_{i}" for i in range(3))]
    names += [f"rot_{i}" for i in range(4)]
    lines = ["ply", "format binary_big_endian 1.0", "comment made by hand", "element vertex 2"]
    lines += ["property uchar flag", *(f"property double {name}" for name in names), "end_header", ""]
    rows = np.arange(2 * len(names), dtype=">f8").reshape(2, -1)
    content = "\n".join(lines).encode() + b"".join(b"\x07" + row.tobytes() for row in rows)
    shape, sh, _ = read(page, "scene.ply", content)
    np.testing.assert_array_equal(shape[:3], rows[:, :3].T)
    np.testing.assert_array_equal(sh, rows[:, 3:6].T)
    np.testing.assert_array_equal(shape[10], rows[:, 6])
    np.testing.assert_allclose(np.linalg.norm(shape[6:10], axis=0), 1, rtol=1e-6)


def test_page_drops_degree_4(page: Page, tmp_path: Path) -> None:
    scene, path = random_scene(30, 16), tmp_path / "higher.ply"
    write_ply_of_degree_4(path, scene)
    _, sh, _ = read(page, path.name, path.read_bytes())
    np.testing.assert_array_equal(np.float32(sh), to_columns(scene)[1])


@pytest.mark.parametrize("has_third_scale", [True, False])
def test_page_reads_flat_gaussians(page: Page, tmp_path: Path, has_third_scale: bool) -> None:
    """A thickness of 0 gets a finite logarithm, and Gaussians of 2DGS a third axis: shaders draw finite ones only."""
    scene, path = random_scene(3000, 4), tmp_path / "flat.ply"
    scene.log_scales[::3, 0] = -np.inf
    scene.log_scales[1::3, 2] = -np.inf
    scene.save(path)
    data = PlyData.read(path)["vertex"].data
    names = [name for name in data.dtype.names if has_third_scale or name != "scale_2"]
    rows = np.array(data[names].tolist(), [(name, "f4") for name in names])
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))
    shape, _, _ = read(page, path.name, path.read_bytes())
    assert np.isfinite(shape).all()
    np.testing.assert_allclose(shape, to_columns(read_scene(path))[0], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kind", [0, 1, 4, 6, 7])
def test_page_turns_stated_axes(page: Page, tmp_path: Path, kind: int) -> None:
    path = tmp_path / "scene.spz"
    path.write_bytes(spz_with(struct.pack("<II3sIII", 0x12340001, 3, b"???", AXES, 4, kind), coefficients=16))
    shape, sh, _ = read(page, path.name, path.read_bytes())
    for found, expected in zip((shape, sh), to_columns(read_scene(path)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("start", [b"\x1f\x8b", b"ply", b"NGSP", b"PGSC"])
def test_page_reads_a_splat_that_begins_like_another_format(page: Page, start: bytes) -> None:
    """It has no header: the bytes of its first number may be any."""
    content = start + splat_of(random_scene(3, 1))[len(start) :]
    shape, _, _ = read(page, "scene.splat", content)
    assert shape[0, 0] == np.frombuffer(content, "<f4")[0]


def spz_with(extensions: bytes, coefficients: int = 1) -> bytes:
    """A .spz of version 4 with extensions."""
    content = bytearray(spz.encode(random_scene(20, coefficients)))
    content[14] |= 2
    content[16:20] = struct.pack("<I", 32 + len(extensions))
    return bytes(content[:32] + extensions + content[32:])


def early_spz(version: int, positions: bytes, more: bytes = b"") -> bytes:
    """A .spz of version 1 or 2 with one Gaussian of degree 0."""
    header = struct.pack("<4sIIBBBB", b"NGSP", version, 1, 0, 12, 0, 0)
    return gzip.compress(header + positions + bytes(10) + more, mtime=0)


def splat_of(scene: Gaussians, scale: float | None = None) -> bytes:
    """A .splat, whose second Gaussian has another standard deviation if one is given."""
    records = np.zeros(len(scene), splat.RECORD)
    records["means"], records["scales"] = scene.means, scene.scales
    if scale is not None:
        records["scales"][1, 1] = scale
    return records.tobytes()


def pgs_with_exponent(exponent: int) -> bytes:
    """A .pgs with another step of its coordinates."""
    parts, kinds = split_sections(Path("scene.pgs"), pgs.encode(random_scene(9, 1)), pgs.KNOWN), dict(pgs.KNOWN)
    parts["scene"] = parts["scene"][:10] + struct.pack("<h", exponent) + parts["scene"][12:]
    return join_sections([Section(name, kinds[name], part) for name, part in parts.items()])


def ply_with(line: str) -> bytes:
    """A .ply with another line among its properties, and room for it."""
    names = ["x", "y", "z", *(f"f_dc_{i}" for i in range(3)), "opacity", *(f"scale_{i}" for i in range(3))]
    names += [f"rot_{i}" for i in range(4)]
    lines = ["ply", "format binary_little_endian 1.0", "element vertex 2", line]
    lines += [*(f"property float {name}" for name in names), "end_header", ""]
    return "\n".join(lines).encode() + bytes(2 * 4 * (len(names) + 1))


REFUSED: list[tuple[str, Callable[[], bytes], str]] = [
    ("a.splat", lambda: splat_of(random_scene(3, 1), -1.0), "negative scales, expected standard deviations"),
    ("a.splat", lambda: splat_of(random_scene(3, 1), np.inf), "1 of 3 Gaussians hold NaN or infinity"),
    ("a.splat", lambda: splat_of(random_scene(3, 1), np.nan), "1 of 3 Gaussians hold NaN or infinity"),
    ("a.spz", lambda: early_spz(1, np.array([1, np.inf, 2], "<f2").tobytes()), "1 of 1 Gaussians hold NaN or infinity"),
    ("a.spz", lambda: early_spz(2, bytes(9), b"more"), "holds more than the bytes for 1 Gaussians"),
    ("a.spz", lambda: spz_with(struct.pack("<III", AXES, 4, 8)), "kind 8, expected one of 0, 1, 4, 6, 7: save it"),
    ("a.spz", lambda: spz_with(struct.pack("<III", AXES, 4, 260)), "kind 260, expected one of 0, 1, 4, 6, 7: save it"),
    ("a.spz", lambda: spz_with(struct.pack("<II", AXES, 0)), "kind none, expected one of 0, 1, 4, 6, 7: save it"),
    ("a.spz", lambda: spz_with(struct.pack("<II3s", 0x12340001, 3, b"???") + b"cut"), "cut short after 3 bytes"),
    ("a.spz", lambda: spz_with(b"").replace(struct.pack("<I12x", 32), bytes(16)), "table of streams at byte 0"),
    ("a.pgs", lambda: pgs_with_exponent(1000), "9 of 9 Gaussians hold NaN or infinity"),
    ("a.ply", lambda: ply_with("property float"), 'holds "property float", expected a property'),
    ("a.ply", lambda: ply_with("property float opacity"), 'holds "property float opacity", expected a property'),
    ("a.ply", lambda: ply_with("prooerty float w"), 'holds "prooerty float w", expected a property'),
    ("a.ply", lambda: ply_with("property constructor w"), "of type constructor, expected numbers"),
]


@pytest.mark.parametrize(("name", "content", "words"), REFUSED, ids=[f"{name}: {words}" for name, _, words in REFUSED])
def test_page_refuses_what_python_refuses(
    page: Page, tmp_path: Path, name: str, content: Callable[[], bytes], words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content())
    with pytest.raises(PocketGSError):
        read_scene(path)
    with pytest.raises(Error, match=words):
        read(page, name, path.read_bytes())


@written
def test_what_is_cut_short_is_refused(page: Page, tmp_path: Path, written: Written) -> None:
    name, write, _ = written
    path = tmp_path / name
    write(path, random_scene(300, 4))
    content = path.read_bytes()
    for end in (0, 3, 10, len(content) // 2 - 7, len(content) - 20):
        with pytest.raises(Error, match=name):
            read(page, name, content[:end])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("notes.txt", b"not a scene at all", "expected .pgs, .ply, .splat, .spz"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", "format is ascii.*convert it first"),
        (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement face 1\nend_header\n",
            "element 'face'.*convert it first",
        ),
        ("a.ply", b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nend_header\n", "compressed"),
        ("a.ply", b"ply\n" + bytes(70_000), "does not end"),
        (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n",
            "cut short",
        ),
        ("a.spz", gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 9, 1, 0, 12, 0, 0), mtime=0), "version 9"),
        (
            "a.spz",
            gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 3, 4_000_000_000, 3, 12, 0, 0), mtime=0),
            "Gaussians would take",
        ),
        ("a.spz", struct.pack("<4sIIBBBB", b"NGSP", 4, 1, 0, 12, 0, 99), "99 streams"),
    ],
)
def test_what_is_no_scene_is_refused(page: Page, name: str, content: bytes, words: str) -> None:
    with pytest.raises(Error, match=words):
        read(page, name, content)


def test_page_refuses_a_pgs_that_states_too_many(page: Page) -> None:
    path = Path("scene.pgs")
    parts = split_sections(path, pgs.encode(random_scene(9, 1)), pgs.KNOWN)
    parts["scene"] = (2**24 + 1).to_bytes(4, "little") + parts["scene"][4:]
    kinds = dict(pgs.KNOWN)
    content = join_sections([Section(name, kinds[name], part) for name, part in parts.items()])
    with pytest.raises(Error, match="16777217 Gaussians, expected at most 16777216"):
        read(page, path.name, content)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.one_of(
        st.binary(max_size=400),
        arrays.arrays(np.uint8, st.integers(1, 60_000), elements=st.sampled_from([0, 1, 2, 7, 200])).map(bytes),
        st.text(alphabet="abcde ", max_size=3000).map(lambda text: text.encode() * 9),
    ),
    level=st.sampled_from([-5, 1, 3, 12, 19]),
    has_checksum=st.booleans(),
)
def test_page_unpacks_zstandard(page: Page, content: bytes, level: int, has_checksum: bool) -> None:
    parameters = spz.zstd.CompressionParameter
    options = {parameters.compression_level: level, parameters.checksum_flag: int(has_checksum)}
    found = page.evaluate(
        """async ([packed, size]) => {
            const { unpackZstd } = await import(new URL("page/formats/zstd.js", document.baseURI));
            return Array.from(unpackZstd(Uint8Array.from(packed), size));
        }""",
        [list(spz.zstd.compress(content, options=options)), len(content)],
    )
    assert bytes(found) == content


LOOP = """async (milliseconds) => {
    const { FrameLoop } = await import(new URL("page/drawing/frame_loop.js", document.baseURI));
    const pause = (time) => new Promise((resolve) => setTimeout(resolve, time));
    // A clock of its own, since frames take longer on a busy machine.
    let time = 0;
    const timer = setInterval(() => (time += 16), 16);
    performance.now = () => time;
    const shares = [];
    const draw = async (share) => {
        shares.push(share);
        time += milliseconds * share;
        await pause(0);
        return true;
    };
    const loop = new FrameLoop(draw, () => {}, () => {});
    loop.invalidate();
    for (let i = 0; i < 40; i++) {
        loop.move();
        await pause(25);
    }
    await pause(1500);
    const atRest = shares.length;
    await pause(500);
    clearInterval(timer);
    delete performance.now;
    return [shares, shares.length - atRest];
}"""


@pytest.mark.parametrize(("milliseconds", "coarsest"), [(5, 1.0), (300, 0.25)])
def test_resolution_drops_only_while_slow_frames_move(page: Page, milliseconds: float, coarsest: float) -> None:
    """It begins low. Frames take so long at full resolution; then the picture rests, sharp, and nothing is drawn."""
    found: Any = page.evaluate(LOOP, milliseconds)
    shares, drawn_at_rest = found
    assert min(shares[1:]) <= coarsest + 0.1
    assert shares[-1] == 1.0
    assert drawn_at_rest == 0
    assert shares[0] == 0.25
    if coarsest == 1.0:
        assert set(shares[8:]) == {1.0}


GIVE_WAY = """async () => {
    const { FrameLoop } = await import(new URL("page/drawing/frame_loop.js", document.baseURI));
    const pause = (time) => new Promise((resolve) => setTimeout(resolve, time));
    const drawn = [];
    let loop;
    let isOld = true;
    const draw = async (share, isWanted) => {
        for (let part = 0; part < 20 * share; part++) {
            await pause(50);
            if (isOld && share === 1 && part === 3) {
                isOld = false;
                loop.invalidate();
            }
            if (!isWanted()) {
                drawn.push("given up");
                return false;
            }
        }
        drawn.push(share);
        return true;
    };
    const rested = new Promise((resolve) => {
        loop = new FrameLoop(draw, () => {}, (rests) => rests && resolve());
        loop.invalidate();
    });
    await rested;
    return drawn;
}"""


def test_a_long_frame_gives_way_to_what_is_newer(page: Page) -> None:
    """To a coarse picture of it first."""
    drawn: Any = page.evaluate(GIVE_WAY)
    assert drawn[1] == "given up"
    assert drawn.count("given up") == 1
    assert max(drawn[0], drawn[2]) < 0.5
    assert drawn[3:] == [1]


SIZES = """async (latency) => {
    const { SubmissionSizes } = await import(new URL("page/drawing/submission_sizes.js", document.baseURI));
    const sizes = new SubmissionSizes();
    const tiles = [sizes.tiles];
    const whole = [sizes.mayDrawWhole(1)];
    for (let i = 0; i < 6; i++) {
        sizes.partTook(sizes.tiles, latency + 0.1 * sizes.tiles);
        tiles.push(sizes.tiles);
    }
    sizes.imageTook(1000, 3 * latency + 90, 3);
    whole.push(sizes.mayDrawWhole(1000), sizes.mayDrawWhole(1600), sizes.mayDrawWhole(2500));
    sizes.imageTook(1000, 3 * latency + 200, 3);
    whole.push(sizes.mayDrawWhole(1000));
    return [tiles, whole];
}"""


@pytest.mark.parametrize("latency", [1, 100])
def test_submissions_grow_to_what_takes_a_tenth_of_a_second(page: Page, latency: float) -> None:
    """However long the browser takes to tell that they are done. Nothing is drawn at once before anything is known."""
    found: Any = page.evaluate(SIZES, latency)
    tiles, whole = found
    assert all(after <= 4 * before for before, after in pairwise(tiles))
    assert 900 < tiles[-1] < 1200
    assert whole == [False, True, True, False, False]


POINTERS = """async () => {
    const { PointerControls } = await import(new URL("page/controls/pointer.js", document.baseURI));
    const element = document.createElement("canvas");
    element.setPointerCapture = () => {}; // the browser knows none of these pointers
    let turns = 0;
    new PointerControls(element, { orbit: () => (turns += 1) }, () => {});
    const send = (type) => element.dispatchEvent(new PointerEvent(type, { pointerId: 7 }));
    return ["pointerup", "pointercancel", "lostpointercapture"].map((end) => {
        turns = 0;
        for (const type of ["pointermove", "pointerdown", "pointermove", end, "pointermove"]) {
            send(type);
        }
        return turns;
    });
}"""


def test_a_drag_ends_however_the_pointer_goes(page: Page) -> None:
    assert page.evaluate(POINTERS) == [1, 1, 1]


THROTTLE = """async () => {
    const { throttled } = await import(new URL("page/live/throttle.js", document.baseURI));
    const happened = [];
    let done;
    const act = (...given) => {
        happened.push(given);
        done();
    };
    const call = throttled(act, () => {
        happened.push("asked");
        return 30;
    });
    for (const round of [[1, 2, 3], [4]]) {
        const acted = new Promise((resolve) => (done = resolve));
        round.forEach((number) => call(number, -number));
        happened.push("called");
        await acted;
    }
    await new Promise((resolve) => setTimeout(resolve, 100));
    return happened;
}"""


def test_pace_lets_a_while_go_by_and_passes_on_the_newest(page: Page) -> None:
    """One call for everything given meanwhile, and another for what is given later."""
    assert page.evaluate(THROTTLE) == ["asked", "called", [3, -3], "asked", "called", [4, -4]]


def test_a_closed_socket_takes_no_command(page: Page) -> None:
    script = """async () => {
        const { followBySocket } = await import(new URL("page/live/socket.js", document.baseURI));
        const [onOpen, onMessage, onScene] = [() => {}, () => {}, () => {}];
        return new Promise((resolve) => {
            const { send } = followBySocket({ onOpen, onMessage, onScene, onClose: () => resolve(send) });
        }).then((send) => send("stop"));
    }"""
    with pytest.raises(Error, match="no connection to the computer"):
        page.evaluate(script)
