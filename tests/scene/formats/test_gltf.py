"""glTF: all kinds of buffers and component types, nodes with transforms, and broken files."""

from __future__ import annotations

import base64
import json
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError
from pocketgs.scene.edits import rotated, scaled, translated
from pocketgs.scene.formats import gltf
from pocketgs.scene.gaussians import Gaussians
from scene.formats.scenes import covariances, random_scene

EXTENSION = "KHR_gaussian_splatting"
Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def scene() -> Gaussians:
    return random_scene(5, 2)


@pytest.fixture
def parts(tmp_path: Path, scene: Gaussians) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk of that scene's `.glb`."""
    gltf.write_gaussians(tmp_path / "whole.glb", scene)
    contents = (tmp_path / "whole.glb").read_bytes()
    (length,) = struct.unpack_from("<I", contents, 12)
    return json.loads(contents[20 : 20 + length]), contents[28 + length :]


def save(path: Path, document: dict[str, Any], binary: bytes) -> Path:
    """Write a `.glb`."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    length = 28 + len(text) + len(binary)
    head = struct.pack("<4sIII4s", b"glTF", 2, length, len(text), b"JSON")
    path.write_bytes(head + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary)
    return path


def same(one: Gaussians, other: Gaussians) -> None:
    np.testing.assert_allclose(one.means, other.means, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(one.sh, other.sh, atol=1e-5)
    np.testing.assert_allclose(one.opacity_logits, other.opacity_logits, atol=1e-4)
    np.testing.assert_allclose(covariances(one), covariances(other), rtol=1e-3, atol=1e-3 * covariances(other).max())


def test_layout(parts: tuple[dict[str, Any], bytes], scene: Gaussians) -> None:
    document, binary = parts
    primitive = document["meshes"][0]["primitives"][0]
    assert document["extensionsUsed"] == [EXTENSION]
    assert primitive["mode"] == 0
    assert primitive["extensions"][EXTENSION] == {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    names = ["POSITION", "COLOR_0", *(f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))]
    names += [f"{EXTENSION}:SH_DEGREE_{d}_COEF_{n}" for d in range(3) for n in range(2 * d + 1)]
    assert list(primitive["attributes"]) == names
    # x points left, y up and z forward.
    positions = np.frombuffer(binary, "<f4", 15).reshape(5, 3)
    np.testing.assert_array_equal(positions, scene.means * [-1, -1, 1])
    assert document["accessors"][0]["max"] == positions.max(axis=0).tolist()
    view = document["bufferViews"][3]
    scales = np.frombuffer(binary, "<f4", 15, view["byteOffset"]).reshape(5, 3)
    np.testing.assert_allclose(scales, scene.scales, rtol=1e-6)


def test_harmonics_are_turned_with_the_axes(parts: tuple[dict[str, Any], bytes], scene: Gaussians) -> None:
    from pocketgs.scene.spherical_harmonics import basis

    document, binary = parts
    starts = [view["byteOffset"] for view in document["bufferViews"][5:]]
    stored = np.stack([np.frombuffer(binary, "<f4", 15, start).reshape(5, 3) for start in starts], axis=1)
    directions = np.random.default_rng(0).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ours = np.einsum("dk,nkc->ndc", basis(directions, 9), scene.sh)
    theirs = np.einsum("dk,nkc->ndc", basis(directions * [-1, -1, 1], 9), stored)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


@pytest.mark.parametrize("place", ["data", "scene.bin", "a%20folder/scene.bin"])
def test_gltf_with_its_buffer_elsewhere(
    tmp_path: Path, parts: tuple[dict[str, Any], bytes], scene: Gaussians, place: str
) -> None:
    document, binary = parts
    if place == "data":
        document["buffers"][0]["uri"] = "data:application/gltf-buffer;base64," + base64.b64encode(binary).decode()
    else:
        document["buffers"][0]["uri"] = place
        (tmp_path / "a folder").mkdir()
        (tmp_path / place.replace("%20", " ")).write_bytes(binary)
    (tmp_path / "scene.gltf").write_text(json.dumps(document))
    same(gltf.read_gaussians(tmp_path / "scene.gltf"), scene)


@pytest.mark.parametrize("uri", ["../scene.bin", "/etc/hosts", "%2E%2E/scene.bin", "link.bin", "a/../../scene.bin"])
def test_buffer_outside_the_folder(tmp_path: Path, parts: tuple[dict[str, Any], bytes], uri: str) -> None:
    document, binary = parts
    document["buffers"][0]["uri"] = uri
    (tmp_path / "scene.bin").write_bytes(binary)
    folder = tmp_path / "inner"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "scene.bin")
    (folder / "scene.gltf").write_text(json.dumps(document))
    with pytest.raises(PocketGSError, match="lies outside"):
        gltf.read_gaussians(folder / "scene.gltf")


def test_quantised_and_interleaved_numbers(
    tmp_path: Path, parts: tuple[dict[str, Any], bytes], scene: Gaussians
) -> None:
    """Rotations as normalised shorts and opacities as bytes, interleaved in records of 12 bytes."""
    document, binary = parts
    unit = scene.quaternions / np.linalg.norm(scene.quaternions, axis=1, keepdims=True) * [1, -1, -1, 1]
    records = np.zeros(5, [("rotation", "<i2", 4), ("opacity", "u1"), ("rest", "u1", 3)])
    records["rotation"] = np.round(np.roll(unit, -1, axis=1) * 32767)
    records["opacity"] = np.round(scene.opacities * 255)
    document["bufferViews"].append(
        {"buffer": 0, "byteOffset": len(binary), "byteLength": records.nbytes, "byteStride": 12}
    )
    view = len(document["bufferViews"]) - 1
    document["accessors"][2] = {"bufferView": view, "componentType": 5122, "normalized": True, "type": "VEC4"}
    document["accessors"][4] = {"bufferView": view, "componentType": 5121, "normalized": True, "type": "SCALAR"}
    document["accessors"][4]["byteOffset"] = 8
    for index in (2, 4):
        document["accessors"][index]["count"] = 5
    document["buffers"][0]["byteLength"] += records.nbytes
    found = gltf.read_gaussians(save(tmp_path / "scene.glb", document, binary + records.tobytes()))
    np.testing.assert_allclose(found.opacities, scene.opacities, atol=1 / 500)
    np.testing.assert_allclose(covariances(found), covariances(scene), atol=1e-3 * covariances(scene).max())


def test_nodes_move_their_gaussians(tmp_path: Path, parts: tuple[dict[str, Any], bytes], scene: Gaussians) -> None:
    """A mesh shown twice: by a child node, and by a node with a matrix."""
    document, binary = parts
    first, second = Rotation.from_euler("xyz", [20, 30, -40], degrees=True), Rotation.from_euler("z", 50, degrees=True)
    matrix = np.eye(4)
    matrix[:3, :3] = second.as_matrix() * 0.5
    matrix[:3, 3] = [7, 8, 9]
    document["nodes"] = [
        {"children": [1], "translation": [1, 2, 3], "scale": [2, 2, 2]},
        {"mesh": 0, "rotation": first.as_quat().tolist()},
        {"mesh": 0, "matrix": matrix.T.ravel().tolist()},
        {"mesh": 0, "name": "not in the scene"},
    ]
    document["scenes"] = [{"nodes": [0, 2]}]
    found = gltf.read_gaussians(save(tmp_path / "scene.glb", document, binary))
    assert len(found) == 10
    turn = np.diag([-1.0, -1.0, 1.0])

    def moved(rotation: np.ndarray, factor: float, offset: list[float]) -> Gaussians:
        """The same in our axes."""
        return translated(rotated(scaled(scene, factor), turn @ rotation @ turn), turn @ np.array(offset))

    one, other = found.select(np.arange(5)), found.select(np.arange(5, 10))
    if abs(one.scales.max() / scene.scales.max() - 0.5) < 0.1:
        one, other = other, one
    same(one, moved(first.as_matrix(), 2.0, [1, 2, 3]))
    same(other, moved(second.as_matrix(), 0.5, [7, 8, 9]))


def test_file_without_scenes(tmp_path: Path, parts: tuple[dict[str, Any], bytes], scene: Gaussians) -> None:
    document, binary = parts
    del document["scene"], document["scenes"]
    document["nodes"] = [{"mesh": 0}, {"children": [0]}]
    same(gltf.read_gaussians(save(tmp_path / "scene.glb", document, binary)), scene)


def test_meshes_of_different_degrees(tmp_path: Path, parts: tuple[dict[str, Any], bytes], scene: Gaussians) -> None:
    document, binary = parts
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    low = {name: index for name, index in attributes.items() if "SH_DEGREE" not in name or "_0_" in name}
    document["meshes"][0]["primitives"].append({**document["meshes"][0]["primitives"][0], "attributes": low})
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 0})
    found = gltf.read_gaussians(save(tmp_path / "scene.glb", document, binary))
    assert found.sh.shape == (10, 9, 3)
    assert not found.sh[5:, 1:].any()


def put(*steps: Any) -> Change:
    """Set the value at a path of keys."""

    def change(document: dict[str, Any]) -> None:
        *path, last, value = steps
        for step in path:
            document = document[step]
        document[last] = value

    return change


PRIMITIVE = ("meshes", 0, "primitives", 0)
SHAPE = (*PRIMITIVE, "extensions", EXTENSION)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("accessors", 0, "count", 10**12), "shows more Gaussians than it has bytes"),
        (put("accessors", 0, "count", 6), "6 elements exceed"),
        (put("accessors", 0, "count", -1), "count is -1"),
        (put("accessors", 0, "count", 4), r"attributes of \[4, 5\] Gaussians"),
        (put("accessors", 0, "byteOffset", 4), "elements exceed"),
        (put("accessors", 0, "bufferView", 99), r"bufferViews\[99\] is missing"),
        (put("accessors", 0, "bufferView", -1), "expected a whole number"),
        (put("accessors", 0, "bufferView", True), "expected a whole number"),
        (put("accessors", 0, "type", "VEC4"), "VEC4 of 5126, expected 3 components"),
        (put("accessors", 0, "componentType", 5125), "VEC3 of 5125"),
        (put("accessors", 0, "sparse", {}), "compressed or sparse"),
        (put("bufferViews", 0, "byteStride", 0), "elements exceed"),
        (put("bufferViews", 0, "byteLength", 10**9), "elements exceed"),
        (put("bufferViews", 0, "buffer", 1), r"buffers\[1\] is missing"),
        (put("bufferViews", 0, "extensions", {"EXT_meshopt_compression": {}}), "uses EXT_meshopt_compression"),
        (put("buffers", 0, "byteLength", 10**12), "cut short"),
        (put("buffers", [5]), "not a list of objects"),
        (put("nodes", 0, "mesh", 3), r"meshes\[3\] is missing"),
        (put("nodes", 0, "children", [0]), "node 0 is reached twice"),
        (put("nodes", 0, "scale", [1, 2, 1]), "stretches, shears or mirrors"),
        (put("nodes", 0, "scale", [-1, 1, 1]), "stretches, shears or mirrors"),
        (put("nodes", 0, "translation", [float("nan"), 0, 0]), "stretches"),
        (put("nodes", 0, "matrix", [1, 2, 3]), "not a valid glTF"),
        (put("nodes", {}), "not a valid glTF|is missing"),
        (put("scenes", 0, "nodes", []), "shows no Gaussians"),
        (put("extensionsRequired", ["KHR_draco_mesh_compression"]), "requires KHR_draco_mesh_compression"),
        (put(*SHAPE, "kernel", "customShape"), "kernel 'customShape'"),
        (put(*SHAPE, "colorSpace", "lin_rec709_display"), "'lin_rec709_display'"),
        (put(*SHAPE, "extensions", {"KHR_spz": {}}), "uses KHR_spz"),
        (put(*PRIMITIVE, "attributes", {}), "0 coefficients of spherical harmonics"),
        (put(*PRIMITIVE, "attributes", f"{EXTENSION}:SCALE", 0), "negative scales"),
    ],
)
def test_broken(tmp_path: Path, parts: tuple[dict[str, Any], bytes], change: Change, message: str) -> None:
    document, binary = parts
    change(document)
    path = save(tmp_path / "scene.glb", document, binary)
    tracemalloc.start()
    try:
        with pytest.raises(PocketGSError, match=rf"scene\.glb.*({message})"):
            gltf.read_gaussians(path)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_numbers_that_are_none(tmp_path: Path, parts: tuple[dict[str, Any], bytes], number: float) -> None:
    document, binary = parts
    with pytest.raises(PocketGSError, match="1 of 5 Gaussians hold NaN or infinity"):
        gltf.read_gaussians(save(tmp_path / "scene.glb", document, struct.pack("<f", number) + binary[4:]))


def test_one_buffer_shown_too_often(tmp_path: Path, parts: tuple[dict[str, Any], bytes]) -> None:
    document, binary = parts
    document["meshes"][0]["primitives"] *= 10_000
    with pytest.raises(PocketGSError, match=r"more Gaussians than it has bytes|more than 4096 groups of Gaussians"):
        gltf.read_gaussians(save(tmp_path / "scene.glb", document, binary))


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        (b"", "JSON cannot be read"),
        (b"[]", "JSON cannot be read|no Gaussians"),
        (b"{}", "shows no Gaussians"),
        (b"[" * 100_000, "JSON cannot be read"),
        (b'{"buffers": [{"byteLength": 1, "uri": "data:text/plain,a"}]}', "expected base64"),
        (b'{"buffers": [{"byteLength": 1, "uri": "data:;base64,?"}]}', "base64 cannot be decoded"),
        (b'{"buffers": [{"byteLength": 1}]}', "expected a file or a data URI"),
        (b'{"buffers": [{"byteLength": "1"}]}', "expected a number of bytes"),
        (b"glTF\1\0\0\0\x0c\0\0\0", "version 1 of GLB"),
        (b"glTF\2\0\0\0\xff\0\0\0", "header states 255"),
        (b"glTF\2\0\0\0\x0c\0\0\0", "first chunk is not JSON"),
        (b"glTF\2\0\0\0\x14\0\0\0\xff\xff\xff\xffJSON", "passes the end"),
    ],
)
def test_broken_containers(tmp_path: Path, contents: bytes, message: str) -> None:
    (tmp_path / "scene.gltf").write_bytes(contents)
    with pytest.raises(PocketGSError, match=f"scene.gltf.*({message})"):
        gltf.read_gaussians(tmp_path / "scene.gltf")


def test_gltf_is_only_read(tmp_path: Path, scene: Gaussians) -> None:
    with pytest.raises(PocketGSError, match=r"expected a name that ends in \.glb"):
        gltf.write_gaussians(tmp_path / "scene.gltf", scene)
