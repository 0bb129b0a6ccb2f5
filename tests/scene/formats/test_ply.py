"""Scenes as `.ply`: bit-exact round trips in the reference layout, and broken files of every kind."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.files.ply_file import read_vertices
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.edits import drawable
from pocketgs.scene.formats.activations import MIN_LOG_SCALE
from pocketgs.scene.gaussians import PARAMETERS, SH_COEFFICIENTS, Gaussians
from pocketgs.scene.warning import SceneWarning
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rendering import render
from scene.formats.scenes import random_scene, write_ply_of_degree_4

LAYOUT = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
LAYOUT_END = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def numbered(count: int, degree: int) -> Gaussians:
    """A scene with unique numbers."""
    shapes = [(count, 3), (count, 3), (count, 4), (count,), (count, SH_COEFFICIENTS[degree], 3)]
    start, arrays = 1, []
    for shape in shapes:
        size = int(np.prod(shape))
        arrays.append(np.arange(start, start + size, dtype=np.float32).reshape(shape))
        start += size
    return Gaussians(*arrays)


def bits(scene: Gaussians) -> list[bytes]:
    return [getattr(scene, name).tobytes() for name in PARAMETERS]


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.ply"
    numbered(2, 1).save(path)
    return path


@pytest.fixture(scope="module")
def module_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for tests that run several examples in one call."""
    return tmp_path_factory.mktemp("ply")


@given(data=st.data(), count=st.integers(1, 5), degree=st.integers(0, 3))
def test_round_trip_keeps_every_bit(module_folder: Path, data: st.DataObject, count: int, degree: int) -> None:
    # Any bit pattern at all: NaN, infinity, denormals and negative zero are numbers that a file must keep, too, except
    # a thickness of 0.
    size = count * (11 + 3 * SH_COEFFICIENTS[degree])
    raw = np.frombuffer(data.draw(st.binary(min_size=4 * size, max_size=4 * size)), np.float32)
    means, log_scales, quaternions, opacity_logits, sh = np.split(raw, count * np.cumsum([3, 3, 4, 1]))
    scene = Gaussians(
        means.reshape(count, 3),
        log_scales.reshape(count, 3),
        quaternions.reshape(count, 4),
        opacity_logits,
        sh.reshape(count, SH_COEFFICIENTS[degree], 3),
    )
    scene.save(module_folder / "scene.ply")
    scene.log_scales = np.where(scene.log_scales == -np.inf, np.float32(MIN_LOG_SCALE), scene.log_scales)
    assert bits(Gaussians.load(module_folder / "scene.ply")) == bits(scene)


def test_a_file_without_gaussians_is_refused(scene_file: Path) -> None:
    vertices = PlyData.read(scene_file)["vertex"].data
    PlyData([PlyElement.describe(vertices[:0], "vertex")], byte_order="<").write(str(scene_file))
    with pytest.raises(PocketGSError, match=r"scene.ply: 0 Gaussians, expected at least one"):
        Gaussians.load(scene_file)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_layout_is_that_of_the_reference(tmp_path: Path, degree: int) -> None:
    scene = numbered(3, degree)
    scene.save(tmp_path / "scene.ply")
    rest = 3 * (SH_COEFFICIENTS[degree] - 1)
    names = [*LAYOUT, *(f"f_rest_{number}" for number in range(rest)), *LAYOUT_END]
    header = ["ply", "format binary_little_endian 1.0", "element vertex 3", *(f"property float {n}" for n in names)]
    raw = (tmp_path / "scene.ply").read_bytes()
    expected_header = "\n".join([*header, "end_header", ""]).encode()
    assert raw.startswith(expected_header)
    rows = np.frombuffer(raw[len(expected_header) :], "<f4").reshape(3, len(names))
    column = {name: rows[:, place] for place, name in enumerate(names)}
    np.testing.assert_array_equal(rows[:, :3], scene.means)
    assert not rows[:, 3:6].any()
    for channel in range(3):
        np.testing.assert_array_equal(column[f"f_dc_{channel}"], scene.sh[:, 0, channel])
        for coefficient in range(1, SH_COEFFICIENTS[degree]):
            name = f"f_rest_{channel * (SH_COEFFICIENTS[degree] - 1) + coefficient - 1}"
            np.testing.assert_array_equal(column[name], scene.sh[:, coefficient, channel])
    np.testing.assert_array_equal(column["opacity"], scene.opacity_logits)
    for axis in range(3):
        np.testing.assert_array_equal(column[f"scale_{axis}"], scene.log_scales[:, axis])
    for part in range(4):
        np.testing.assert_array_equal(column[f"rot_{part}"], scene.quaternions[:, part])


@pytest.mark.parametrize("byte_order", ["<", ">", "text"])
def test_other_writers_files_are_read(tmp_path: Path, byte_order: str) -> None:
    """Other byte orders, text, doubles, more or reordered properties, more elements, no normals."""
    scene = numbered(4, 1)
    scene.save(tmp_path / "ours.ply")
    ours = PlyData.read(tmp_path / "ours.ply")["vertex"].data
    names = [name for name in reversed(ours.dtype.names) if not name.startswith("n")]
    theirs = np.zeros(4, [("segment", "i4"), *((name, "f8") for name in names)])
    for name in names:
        theirs[name] = ours[name]
    faces = np.array([([0, 1, 2],)], dtype=[("vertex_indices", "O")])
    elements = [PlyElement.describe(theirs, "vertex"), PlyElement.describe(faces, "face")]
    text = byte_order == "text"
    PlyData(elements, text=text, byte_order="=" if text else byte_order).write(str(tmp_path / "theirs.ply"))
    assert bits(Gaussians.load(tmp_path / "theirs.ply")) == bits(scene)


def test_loaded_scene_does_not_depend_on_the_file(tmp_path: Path) -> None:
    scene = numbered(1, 0)
    scene.save(tmp_path / "scene.ply")
    loaded = Gaussians.load(tmp_path / "scene.ply")
    with (tmp_path / "scene.ply").open("rb+") as file:
        file.write(bytes((tmp_path / "scene.ply").stat().st_size))
    assert bits(loaded) == bits(scene)


def test_file_cut_off_anywhere(scene_file: Path) -> None:
    whole = scene_file.read_bytes()
    for length in range(len(whole)):
        scene_file.write_bytes(whole[:length])
        with pytest.raises(PocketGSError, match=r"scene\.ply"):
            Gaussians.load(scene_file)


@given(garbage=st.binary(max_size=300), head=st.integers(0, 700))
def test_garbage(module_folder: Path, garbage: bytes, head: int) -> None:
    """Random bytes alone, and after the beginning of a valid file."""
    sound, path = module_folder / "sound.ply", module_folder / "garbage.ply"
    numbered(2, 1).save(sound)
    for content in (garbage, sound.read_bytes()[:head] + garbage):
        path.write_bytes(content)
        load_or_refuse(path)


@given(data=st.data())
def test_damaged_header(module_folder: Path, data: st.DataObject) -> None:
    path = module_folder / "damaged.ply"
    numbered(2, 1).save(path)
    header, end, body = path.read_bytes().partition(b"end_header\n")
    lines = header.splitlines()
    odd = st.sampled_from(
        [b"", b"property list uchar float x", b"element", b"element vertex -3", b"property float", b"x"]
    )
    for _ in range(data.draw(st.integers(1, 3))):
        lines[data.draw(st.integers(0, len(lines) - 1))] = data.draw(odd)
    path.write_bytes(b"\n".join(lines) + b"\n" + end + body)
    load_or_refuse(path)


def load_or_refuse(path: Path) -> None:
    """Any file gives a scene or our own exception."""
    try:
        scene = Gaussians.load(path)
    except PocketGSError:
        return
    assert len(scene) <= path.stat().st_size


@pytest.mark.parametrize("name", ["x", "f_dc_1", "f_rest_4", "opacity", "scale_1", "rot_0"])
def test_missing_property(scene_file: Path, name: str) -> None:
    rewrite_header(scene_file, lambda lines: [line for line in lines if line.split()[-1] != name])
    with pytest.raises(PocketGSError, match=r"f_rest|missing|readable"):
        Gaussians.load(scene_file)


@pytest.mark.parametrize("form", ["<", ">", "text"])
def test_comment_in_any_language(tmp_path: Path, form: str) -> None:
    scene = numbered(3, 1)
    scene.save(tmp_path / "scene.ply")
    elements = [PlyElement.describe(np.array(PlyData.read(tmp_path / "scene.ply")["vertex"].data), "vertex")]
    text = form == "text"
    PlyData(elements, text=text, byte_order="=" if text else form).write(str(tmp_path / "scene.ply"))
    content = (tmp_path / "scene.ply").read_bytes()
    for comment in ("Räume, 部屋".encode(), bytes(range(128, 256))):
        (tmp_path / "scene.ply").write_bytes(content.replace(b"element", b"comment " + comment + b"\nelement", 1))
        assert bits(Gaussians.load(tmp_path / "scene.ply")) == bits(scene)


def test_comment_in_any_language_takes_no_more_memory(tmp_path: Path) -> None:
    """The file is mapped, not copied, whatever the header holds."""
    vertices = np.zeros(2_000_000, [("x", "f4"), ("y", "f4"), ("z", "f4")])
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(tmp_path / "large.ply"))
    content = (tmp_path / "large.ply").read_bytes()
    (tmp_path / "large.ply").write_bytes(content.replace(b"element", "comment é\nelement".encode(), 1))
    tracemalloc.start()
    try:
        found = read_vertices(tmp_path / "large.ply")
        assert len(found) == 2_000_000
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_gaussians_with_two_axes(tmp_path: Path) -> None:
    """Those of 2DGS have no third axis: they become discs, a thousandth as thick as the smaller of the two."""
    scene = numbered(3, 1)
    scene.log_scales[:] = [[-3, -2, 0], [-2, -4, 0], [-3, -np.inf, 0]]
    scene.save(tmp_path / "scene.ply")
    data = PlyData.read(tmp_path / "scene.ply")["vertex"].data
    names = [name for name in data.dtype.names if name != "scale_2"]
    flat = np.array(data[names].tolist(), [(name, "f4") for name in names])
    PlyData([PlyElement.describe(flat, "vertex")]).write(str(tmp_path / "flat.ply"))
    found = Gaussians.load(tmp_path / "flat.ply")
    thin = np.log(1e-3)
    expected = [[-3, -2, -3 + thin], [-2, -4, -4 + thin], [-3, MIN_LOG_SCALE, MIN_LOG_SCALE]]
    np.testing.assert_allclose(found.log_scales, expected, rtol=1e-6)
    assert bits(found)[2:] == bits(scene)[2:]


def test_thickness_of_nothing(tmp_path: Path) -> None:
    """It is drawn the same with finite numbers, which every format holds."""
    scene = random_scene(40, 1, extent=1.0)
    scene.log_scales[:] = [-2, -3, -np.inf]
    scene.save(tmp_path / "scene.ply")
    found = Gaussians.load(tmp_path / "scene.ply")
    assert np.isfinite(found.log_scales).all()
    assert drawable(found) is found
    pose = look_at(np.array([0.0, 0.5, -4.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    camera = Camera(64, 48, 60.0, 60.0, 32.0, 24.0, pose)
    pictures = [render(each, camera, engine=EngineOptions(engine="cpu")).image for each in (scene, found)]
    assert pictures[0].std() > 0.05
    np.testing.assert_array_equal(pictures[0], pictures[1])
    for suffix in (".pgs", ".spz", ".sog", ".splat", ".glb", ".compressed.ply"):
        found.save(tmp_path / f"scene{suffix}")
        assert len(Gaussians.load(tmp_path / f"scene{suffix}")) == 40


def test_wrong_number_of_rest_coefficients(scene_file: Path) -> None:
    rewrite_header(scene_file, lambda lines: [line for line in lines if line.split()[-1] != "f_rest_8"])
    with pytest.raises(PocketGSError, match="8 f_rest properties, expected 0, 9, 24, 45 or 72"):
        Gaussians.load(scene_file)


def test_degree_4_is_dropped(tmp_path: Path) -> None:
    scene = random_scene(20, 3)
    write_ply_of_degree_4(tmp_path / "higher.ply", scene)
    with pytest.warns(SceneWarning, match=r"higher\.ply: spherical harmonics of degree 4, which are dropped"):
        found = Gaussians.load(tmp_path / "higher.ply")
    np.testing.assert_array_equal(found.sh, scene.sh)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("count", [3, 10**7, 10**9, 10**12, 10**30])
@pytest.mark.parametrize("listed", [False, True])
def test_header_that_promises_more_than_there_is(tmp_path: Path, kind: str, count: int, listed: bool) -> None:
    path = tmp_path / "scene.ply"
    properties = "".join(f"property {'list uchar ' * listed}float {name}\n" for name in LAYOUT + LAYOUT_END)
    path.write_text(f"ply\nformat {kind} 1.0\nelement vertex {count}\n{properties}end_header\n")
    tracemalloc.start()
    try:
        with pytest.raises(PocketGSError, match=r"cut short|readable"):
            Gaussians.load(path)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("line_end", ["\r", "\r\n"])
def test_promise_behind_other_line_ends(tmp_path: Path, line_end: str) -> None:
    lines = ["ply", "format ascii 1.0", "element vertex 1000000000", "property list uchar float x", "end_header", ""]
    (tmp_path / "scene.ply").write_bytes(line_end.join(lines).encode())
    with pytest.raises(PocketGSError, match="cut short"):
        Gaussians.load(tmp_path / "scene.ply")


def test_property_that_is_a_list(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    properties = "".join(f"property list uchar float {name}\n" for name in LAYOUT + LAYOUT_END)
    numbers = " ".join(["2 0.5 0.5"] * len(LAYOUT + LAYOUT_END))
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n{numbers}\n")
    with pytest.raises(PocketGSError, match="'x' is missing or not a number"):
        Gaussians.load(path)


def test_mesh_holds_no_gaussians(tmp_path: Path) -> None:
    vertices = np.zeros(3, [("x", "f4"), ("y", "f4"), ("z", "f4")])
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(tmp_path / "mesh.ply"))
    with pytest.raises(PocketGSError, match="holds no Gaussians"):
        Gaussians.load(tmp_path / "mesh.ply")


def test_paths_that_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.ply", tmp_path, tmp_path / ("long" * 100 + ".ply")):
        with pytest.raises(PocketGSError):
            Gaussians.load(path)


def test_paths_that_cannot_be_written(scene_file: Path) -> None:
    before = scene_file.read_bytes()
    folder = scene_file.parent
    (folder / "taken.ply").mkdir()
    scene = numbered(1, 0)
    for path in (folder / "none" / "a.ply", scene_file / "a.ply", folder / "taken.ply", Path("."), Path("/")):
        with pytest.raises(PocketGSError):
            scene.save(path)
    assert scene_file.read_bytes() == before
    assert sorted(path.name for path in folder.iterdir()) == ["scene.ply", "taken.ply"]


def test_disk_that_fills_up(scene_file: Path) -> None:
    """A file size limit stops the writer half-way, like a full disk."""
    pytest.importorskip("resource")
    before = scene_file.read_bytes()
    program = (
        "import resource, sys; import numpy as np; from pocketgs import Gaussians, PocketGSError\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "scene = Gaussians(*(np.zeros((100, *tail)) for tail in [(3,), (3,), (4,), (), (1, 3)]))\n"
        "try: scene.save(sys.argv[1])\n"
        "except PocketGSError as error: print(error)"
    )
    result = subprocess.run([sys.executable, "-c", program, str(scene_file)], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert "scene.ply: cannot be written (File too large)" in result.stdout
    assert scene_file.read_bytes() == before
    assert [path.name for path in scene_file.parent.iterdir()] == ["scene.ply"]


def rewrite_header(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    header, end, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.decode() for line in header.splitlines()]
    path.write_bytes("\n".join(change(lines)).encode() + b"\n" + end + body)
