"""`.compressed.ply`: packed words, files of earlier writers, and broken ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats import compressed_ply
from pocketgs.scene.gaussians import SH_DC
from scene.formats.scenes import random_scene


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file of 300 Gaussians of degree 1, in two chunks."""
    compressed_ply.write_gaussians(tmp_path / "scene.compressed.ply", random_scene(300, 1))
    return tmp_path / "scene.compressed.ply"


def rewrite(path: Path, change: Callable[[dict[str, np.ndarray]], None]) -> None:
    elements = {element.name: element.data.copy() for element in PlyData.read(str(path)).elements}
    change(elements)
    described = [PlyElement.describe(data, name) for name, data in elements.items()]
    PlyData(described, byte_order="<").write(str(path))


def test_layout(path: Path) -> None:
    elements = {element.name: element.data for element in PlyData.read(str(path)).elements}
    assert [(name, len(data), len(data.dtype)) for name, data in elements.items()] == [
        ("chunk", 2, 18),
        ("vertex", 300, 4),
        ("sh", 300, 9),
    ]
    assert path.read_bytes().startswith(
        b"ply\nformat binary_little_endian 1.0\nelement chunk 2\nproperty float min_x\n"
    )


def test_words(path: Path) -> None:
    """One Gaussian decoded by hand."""
    elements = {element.name: element.data for element in PlyData.read(str(path)).elements}
    chunk, vertex = elements["chunk"][1], elements["vertex"][280]
    scene = compressed_ply.read_gaussians(path)

    def between(kind: str, axis: str, fraction: float) -> float:
        return chunk[f"min_{kind}{axis}"] * (1 - fraction) + chunk[f"max_{kind}{axis}"] * fraction

    for kind, word, numbers in (
        ("", int(vertex["packed_position"]), scene.means),
        ("scale_", int(vertex["packed_scale"]), scene.log_scales),
    ):
        fractions = ((word >> 21) / 2047, (word >> 11 & 1023) / 1023, (word & 2047) / 2047)
        expected = [between(kind, axis, fraction) for axis, fraction in zip("xyz", fractions, strict=True)]
        np.testing.assert_allclose(numbers[280], expected, rtol=1e-5)
    word = int(vertex["packed_color"])
    colours = [between("", axis, (word >> shift & 255) / 255) for axis, shift in (("r", 24), ("g", 16), ("b", 8))]
    np.testing.assert_allclose(0.5 + SH_DC * scene.sh[280, 0], colours, atol=1e-6)
    np.testing.assert_allclose(scene.opacities[280], (word & 255) / 255, atol=1e-6)
    word = int(vertex["packed_rotation"])
    others = [((word >> shift & 1023) / 1023 - 0.5) * 2**0.5 for shift in (20, 10, 0)]
    others.insert(word >> 30, (1 - sum(number**2 for number in others)) ** 0.5)
    np.testing.assert_allclose(scene.quaternions[280], others, atol=1e-6)


def test_file_of_an_earlier_writer(path: Path) -> None:
    """Chunks without colour bounds: packed colours are absolute."""

    def drop(elements: dict[str, np.ndarray]) -> None:
        names = [name for name in elements["chunk"].dtype.names if name[4:] not in ("r", "g", "b")]
        elements["chunk"] = np.array(elements["chunk"][names].tolist(), [(name, "<f4") for name in names])

    words = PlyData.read(str(path))["vertex"].data["packed_color"].copy()
    rewrite(path, drop)
    scene = compressed_ply.read_gaussians(path)
    np.testing.assert_allclose(0.5 + SH_DC * scene.sh[:, 0, 0], (words >> 24) / 255, atol=1e-6)


def set_first(element: str, name: str, number: float) -> Callable[[dict[str, np.ndarray]], None]:
    def change(elements: dict[str, np.ndarray]) -> None:
        elements[element][name][0] = number

    return change


def keep(element: str, count: int) -> Callable[[dict[str, np.ndarray]], None]:
    def change(elements: dict[str, np.ndarray]) -> None:
        elements[element] = elements[element][:count]

    return change


def rename(element: str, name: str) -> Callable[[dict[str, np.ndarray]], None]:
    def change(elements: dict[str, np.ndarray]) -> None:
        dtype = elements[element].dtype
        renamed = [("other" if each == name else each, dtype[each]) for each in dtype.names]
        elements[element] = elements[element].view(renamed)

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (keep("chunk", 1), "1 chunks, expected 2 for 300 Gaussians"),
        (keep("vertex", 200), "2 chunks, expected 1 for 200 Gaussians"),
        (keep("sh", 299), "sh has 299 rows of 9, expected 300"),
        (rename("chunk", "max_y"), "'max_y' of element 'chunk' is missing"),
        (rename("vertex", "packed_scale"), "'packed_scale' of element 'vertex' is missing"),
        (rename("sh", "f_rest_3"), "'f_rest_3' of element 'sh' is missing"),
        (set_first("chunk", "min_x", np.nan), "256 of 300 Gaussians hold NaN"),
        (set_first("chunk", "max_scale_z", np.inf), "256 of 300 Gaussians hold NaN or infinity"),
    ],
)
def test_broken(path: Path, change: Callable[[dict[str, np.ndarray]], None], message: str) -> None:
    rewrite(path, change)
    with pytest.raises(PocketGSError, match=rf"scene\.compressed\.ply.*{message}"):
        compressed_ply.read_gaussians(path)


def test_plain_ply_of_that_name(tmp_path: Path) -> None:
    random_scene(3, 0).save(tmp_path / "plain.ply")
    assert not compressed_ply.recognises(tmp_path / "plain.ply")
    with pytest.raises(PocketGSError, match="'packed_position' of element 'vertex' is missing"):
        compressed_ply.read_gaussians(tmp_path / "plain.ply")
