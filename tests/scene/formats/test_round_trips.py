"""Round trips of random scenes through each format stay within its stated rounding errors."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats import FORMATS, format_of, is_scene_name, read_scene, write_scene
from pocketgs.scene.gaussians import SH_DC, Gaussians
from pocketgs.scene.morton import morton_order
from scene.formats.scenes import load_or_refuse, opacity_error, random_scene, scenes, turns_between

LOSSY = (".compressed.ply", ".spz", ".splat", ".glb", ".pgs", ".sog")
COLOUR_RANGE = 0.4
"""Range of colours in .spz beyond 0 and 1."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for tests that run several examples in one call."""
    return tmp_path_factory.mktemp("formats")


def again(folder: Path, scene: Gaussians, suffix: str) -> Gaussians:
    write_scene(folder / f"scene{suffix}", scene)
    found = read_scene(folder / f"scene{suffix}")
    assert len(found) == len(scene)
    return found


def farthest(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.abs(first.astype(np.float64) - second).max(initial=0))


@given(scene=scenes())
def test_spz(folder: Path, scene: Gaussians) -> None:
    found = again(folder, scene, ".spz")
    assert found.sh_degree == scene.sh_degree
    assert farthest(found.means, scene.means) <= np.abs(scene.means).max() * 2.0**-23 * 1.001 + 2.0**-24
    assert farthest(found.log_scales, scene.log_scales) <= 1 / 32 + 1e-5
    assert farthest(found.sh[:, 0], scene.sh[:, 0]) * SH_DC <= 1 / 250
    assert farthest(found.sh[:, 1:], scene.sh[:, 1:]) <= 0.008
    assert opacity_error(found, scene) <= 1 / 500
    assert turns_between(found, scene).max() <= 0.3


@given(scene=scenes())
def test_compressed_ply(folder: Path, scene: Gaussians) -> None:
    found = again(folder, scene, ".compressed.ply")
    ordered = scene.select(morton_order(scene.means))
    assert found.sh_degree == scene.sh_degree
    for start in range(0, len(scene), 256):
        here, there = (each.select(np.arange(start, min(start + 256, len(scene)))) for each in (ordered, found))
        steps = np.array([2047, 1023, 2047]) * 2
        for name, rounding in (("means", np.abs(here.means).max() * 2e-7), ("log_scales", 2e-6)):
            expected = getattr(here, name)
            allowed = np.ptp(expected, axis=0) / steps + rounding
            assert (np.abs(getattr(there, name) - expected) <= allowed).all(), name
        allowed = np.ptp(here.sh[:, 0], axis=0) / 510 + 2e-6
        assert (np.abs(there.sh[:, 0] - here.sh[:, 0]) <= allowed).all()
    assert farthest(found.sh[:, 1:], ordered.sh[:, 1:]) <= 1 / 64 + 1e-6
    assert opacity_error(found, ordered) <= 1 / 500
    assert turns_between(found, ordered).max() <= 0.3


@given(scene=scenes())
def test_splat(folder: Path, scene: Gaussians) -> None:
    found = again(folder, scene, ".splat")
    importance = scene.log_scales.astype(np.float64).sum(axis=1) - np.logaddexp(0, -scene.opacity_logits)
    ordered = scene.select(np.argsort(-importance, kind="stable"))
    assert found.sh_degree == 0
    assert found.means.tobytes() == ordered.means.tobytes()
    assert farthest(found.log_scales, ordered.log_scales) <= 1e-5
    colours = np.clip(0.5 + SH_DC * ordered.sh[:, 0], 0, 1)
    assert farthest(0.5 + SH_DC * found.sh[:, 0], colours) <= 1 / 500
    assert opacity_error(found, ordered) <= 1 / 500
    assert turns_between(found, ordered).max() <= 1.0


@given(scene=scenes())
def test_glb(folder: Path, scene: Gaussians) -> None:
    found = again(folder, scene, ".glb")
    assert np.array_equal(found.means, scene.means)
    assert np.array_equal(found.sh, scene.sh)
    assert farthest(found.log_scales, scene.log_scales) <= 2e-6
    assert opacity_error(found, scene) <= 1e-7
    assert turns_between(found, scene).max() <= 1e-4


@pytest.mark.parametrize("suffix", LOSSY)
def test_a_second_writing_loses_nothing_more(tmp_path: Path, suffix: str) -> None:
    """A second round trip changes nothing, except at a chunk's bounds in .compressed.ply."""
    once = again(tmp_path, random_scene(500, 2), suffix)
    twice = again(tmp_path, once, suffix)
    rounding = 1e-3 if suffix == ".compressed.ply" else 2e-6
    ordered = once.select(morton_order(once.means)) if suffix == ".compressed.ply" else once
    # Equally important Gaussians may change places in a .splat, whose order is by what was rounded.
    order = [np.lexsort(each.means.T) if suffix == ".splat" else slice(None) for each in (ordered, twice)]
    for name in ("means", "log_scales", "sh"):
        assert farthest(getattr(ordered, name)[order[0]], getattr(twice, name)[order[1]]) <= rounding * 10, name


@pytest.mark.parametrize("suffix", LOSSY)
@pytest.mark.parametrize(
    ("name", "number"),
    [("means", np.nan), ("log_scales", np.inf), ("quaternions", np.nan), ("opacity_logits", np.nan), ("sh", -np.inf)],
)
def test_numbers_that_are_none_are_not_written(tmp_path: Path, suffix: str, name: str, number: float) -> None:
    scene = random_scene(4, 1)
    getattr(scene, name)[2] = number
    (tmp_path / f"scene{suffix}").write_bytes(b"before")
    with pytest.raises(PocketGSError, match=r"scene.*1 of 4 Gaussians hold NaN or infinity"):
        write_scene(tmp_path / f"scene{suffix}", scene)
    assert (tmp_path / f"scene{suffix}").read_bytes() == b"before"


@pytest.mark.parametrize("suffix", [*LOSSY, ".ply"])
def test_empty_scene_is_not_written(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(PocketGSError, match="0 Gaussians"):
        write_scene(tmp_path / f"scene{suffix}", random_scene(0, 1))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", LOSSY)
def test_folder_that_is_not_there(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(PocketGSError, match="cannot be written"):
        write_scene(tmp_path / "none" / f"scene{suffix}", random_scene(1, 0))


@pytest.mark.parametrize("suffix", [*LOSSY, ".ply", ".gltf"])
def test_file_that_is_not_there(tmp_path: Path, suffix: str) -> None:
    for path in (tmp_path / f"scene{suffix}", tmp_path):
        with pytest.raises(PocketGSError):
            read_scene(path)


@pytest.mark.parametrize("suffix", LOSSY)
@pytest.mark.parametrize("degree", [0, 3])
def test_file_cut_off_anywhere(tmp_path: Path, suffix: str, degree: int) -> None:
    path = tmp_path / f"scene{suffix}"
    write_scene(path, random_scene(3, degree))
    whole = path.read_bytes()
    for length in range(0, len(whole), 23 if suffix == ".sog" else 1):
        path.write_bytes(whole[:length])
        # Without a header, fewer records are a smaller scene.
        if suffix == ".splat" and length and length % 32 == 0:
            assert len(read_scene(path)) == length // 32
            continue
        with pytest.raises(PocketGSError, match="scene"):
            read_scene(path)


@given(suffix=st.sampled_from(LOSSY), garbage=st.binary(max_size=300), head=st.integers(0, 900))
def test_garbage(folder: Path, suffix: str, garbage: bytes, head: int) -> None:
    """Random bytes alone, and after the beginning of a valid file."""
    write_scene(folder / f"sound{suffix}", random_scene(5, 1))
    for content in (garbage, (folder / f"sound{suffix}").read_bytes()[:head] + garbage):
        (folder / f"garbage{suffix}").write_bytes(content)
        load_or_refuse(folder / f"garbage{suffix}")


@given(suffix=st.sampled_from(LOSSY), data=st.data())
def test_single_wrong_bytes(folder: Path, suffix: str, data: st.DataObject) -> None:
    write_scene(folder / f"sound{suffix}", random_scene(5, 1))
    content = bytearray((folder / f"sound{suffix}").read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    (folder / f"wrong{suffix}").write_bytes(content)
    tracemalloc.start()
    try:
        load_or_refuse(folder / f"wrong{suffix}")
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_names_choose_formats(tmp_path: Path) -> None:
    assert format_of(Path("a.compressed.ply")).name == "PlayCanvas compressed PLY"
    assert format_of(Path("A.PLY")).name == "3DGS PLY"
    assert is_scene_name(Path("a.GLB"))
    assert not is_scene_name(Path("transforms.json"))
    for name in ("scene", "scene.obj", "ply"):
        with pytest.raises(PocketGSError, match=r"expected one that ends in \.compressed\.ply, \.ply"):
            write_scene(tmp_path / name, random_scene(1, 0))
    assert not list(tmp_path.iterdir())


def test_compressed_ply_is_recognised_by_what_is_in_it(tmp_path: Path) -> None:
    write_scene(tmp_path / "a.compressed.ply", random_scene(3, 1))
    (tmp_path / "a.compressed.ply").rename(tmp_path / "plain.ply")
    assert len(Gaussians.load(tmp_path / "plain.ply")) == 3


def test_gaussians_save_and_load_any_format(tmp_path: Path) -> None:
    for suffix in (suffix for each in FORMATS for suffix in each.suffixes if suffix != ".gltf"):
        random_scene(3, 1).save(str(tmp_path / f"a{suffix}"))
        assert len(Gaussians.load(str(tmp_path / f"a{suffix}"))) == 3
