"""Exchange of files with other programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pocketgs.scene.edits import rotated
from pocketgs.scene.formats import read_scene, spz, write_scene
from pocketgs.scene.formats.spz_precision import FINE, SMALL, Precision
from pocketgs.scene.gaussians import Gaussians
from scene.formats.scenes import covariances, opacity_error, random_scene, turns_between

pytestmark = pytest.mark.slow
DEGREES = pytest.mark.parametrize("degree", [0, 1, 2, 3])


def scene_of(degree: int) -> Gaussians:
    return random_scene(700, degree, seed=degree, extent=20.0)


@pytest.fixture
def scene(degree: int) -> Gaussians:
    return scene_of(degree)


def close(found: Gaussians, expected: Gaussians, means: float, log_scales: float, sh: float, turn: float) -> None:
    """The same Gaussians in the same order, to these errors."""
    assert found.sh.shape == expected.sh.shape
    np.testing.assert_allclose(found.means, expected.means, atol=means)
    np.testing.assert_allclose(found.log_scales, expected.log_scales, atol=log_scales)
    np.testing.assert_allclose(found.sh, expected.sh, atol=sh)
    assert opacity_error(found, expected) <= 1 / 400
    assert turns_between(found, expected).max() <= turn


@DEGREES
@pytest.mark.parametrize("suffix", [".ply", ".spz", ".compressed.ply", ".splat", ".sog"])
def test_ours_elsewhere(
    tmp_path: Path, as_read_elsewhere: Callable[[Path], Gaussians], scene: Gaussians, suffix: str
) -> None:
    """Splat-transform and our readers read the same scene from our files."""
    path = tmp_path / f"ours{suffix}"
    write_scene(path, scene)
    theirs = as_read_elsewhere(path)
    # It takes a rotation's byte in a .splat for half a step less than the format's own viewer does.
    close(theirs, read_scene(path), means=1e-6, log_scales=1e-5, sh=1e-5, turn=1.0 if suffix == ".splat" else 0.1)


@pytest.mark.parametrize("degree", [0, 3])
def test_theirs_in_sog(tmp_path: Path, splat_transform: Callable[..., None], scene: Gaussians) -> None:
    """We read the files of splat-transform, without a table of harmonics and with one."""
    write_scene(tmp_path / "ours.ply", scene)
    splat_transform("-g", "cpu", tmp_path / "ours.ply", tmp_path / "theirs.sog")
    splat_transform(tmp_path / "theirs.sog", tmp_path / "again.ply")
    close(read_scene(tmp_path / "theirs.sog"), read_scene(tmp_path / "again.ply"), 1e-4, 1e-5, 1e-5, 0.2)


@DEGREES
@pytest.mark.parametrize("version", [3, 4])
def test_our_small_spz_elsewhere(
    tmp_path: Path, as_read_elsewhere: Callable[[Path], Gaussians], scene: Gaussians, version: spz.Version
) -> None:
    """splat-transform reads every Gaussian, within the file's precision."""
    scene.log_scales -= 7  # to less than the distances between Gaussians
    spz.write_gaussians(tmp_path / "small.spz", scene, version, SMALL)
    theirs = as_read_elsewhere(tmp_path / "small.spz")
    assert len(theirs) == len(scene)
    close(theirs, read_scene(tmp_path / "small.spz"), means=1e-6, log_scales=1e-5, sh=1e-5, turn=0.1)
    distance = np.abs(theirs.means[:, None] - scene.means).max(axis=2)
    nearest = distance.argmin(axis=1)
    assert sorted(nearest) == list(range(len(scene)))
    size = np.exp(np.percentile(np.median(scene.log_scales, axis=1), 10, method="lower"))
    assert distance.min(axis=1).max() <= size / 8 + 2e-6


@DEGREES
@pytest.mark.parametrize("version", [3, 4])
def test_theirs_in_spz(tmp_path: Path, splat_transform: Callable[..., None], scene: Gaussians, version: int) -> None:
    scene.save(tmp_path / "ours.ply")
    splat_transform("--spz-version", version, tmp_path / "ours.ply", tmp_path / "theirs.spz")
    found = read_scene(tmp_path / "theirs.spz")
    # 12 fractional bits, whatever the scene's size.
    close(found, scene, means=2.0**-13 + 1e-6, log_scales=1 / 32 + 1e-5, sh=0.067, turn=0.3)


@DEGREES
def test_theirs_in_compressed_ply(tmp_path: Path, splat_transform: Callable[..., None], scene: Gaussians) -> None:
    scene.save(tmp_path / "ours.ply")
    splat_transform(tmp_path / "ours.ply", tmp_path / "theirs.compressed.ply")
    found = read_scene(tmp_path / "theirs.compressed.ply")
    distance = np.linalg.norm(found.means[:, None] - scene.means, axis=2)
    nearest = distance.argmin(axis=1)
    close(found, scene.select(nearest), means=0.021, log_scales=0.008, sh=0.02, turn=0.3)
    assert len(set(nearest)) > 0.95 * len(scene)


@DEGREES
def test_theirs_in_glb(tmp_path: Path, splat_transform: Callable[..., None], scene: Gaussians) -> None:
    scene.save(tmp_path / "ours.ply")
    splat_transform(tmp_path / "ours.ply", tmp_path / "theirs.glb")
    found = read_scene(tmp_path / "theirs.glb")
    np.testing.assert_allclose(found.means, scene.means, atol=1e-5)
    np.testing.assert_allclose(found.sh, scene.sh, atol=1e-5)
    assert opacity_error(found, scene) <= 1e-6
    # It turns the axes by another half turn of each Gaussian, which the Gaussian does not show.
    largest = covariances(scene).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(covariances(found) / largest, covariances(scene) / largest, atol=1e-4)


@DEGREES
def test_our_glb_elsewhere(tmp_path: Path, run_node: Callable[..., str], scene: Gaussians) -> None:
    """Khronos' validator only reports an extension it does not know; glTF-Transform reads the same numbers."""
    path = tmp_path / "ours.glb"
    write_scene(path, scene)
    program = """
        import { readFileSync } from "node:fs";
        import { NodeIO } from "@gltf-transform/core";
        import validator from "gltf-validator";
        const report = await validator.validateBytes(new Uint8Array(readFileSync(process.argv[2])));
        const document = await new NodeIO().read(process.argv[2]);
        const [primitive] = document.getRoot().listMeshes()[0].listPrimitives();
        const attributes = Object.fromEntries(primitive.listSemantics().map((name) => {
            const accessor = primitive.getAttribute(name);
            return [name, Array.from({length: accessor.getCount()}, (_, i) => accessor.getElement(i, []))];
        }));
        console.log(JSON.stringify({codes: report.issues.messages.map(({code}) => code),
            vertices: report.info.totalVertexCount, mode: primitive.getMode(), attributes}));
    """
    found = json.loads(run_node(program, path))
    assert set(found["codes"]) == {"UNSUPPORTED_EXTENSION", "MESH_PRIMITIVE_INVALID_ATTRIBUTE"}
    assert (found["vertices"], found["mode"]) == (len(scene), 0)
    attributes = {name.split(":")[-1]: np.array(values) for name, values in found["attributes"].items()}
    np.testing.assert_allclose(attributes["POSITION"], scene.means * [-1, -1, 1], rtol=1e-6)
    np.testing.assert_allclose(attributes["SCALE"], scene.scales, rtol=1e-6)
    np.testing.assert_allclose(attributes["OPACITY"][:, 0], scene.opacities, atol=1e-6)
    np.testing.assert_allclose(attributes["SH_DEGREE_0_COEF_0"], scene.sh[:, 0], rtol=1e-6)
    assert sum(name.startswith("SH_") for name in attributes) == scene.sh.shape[1]


@pytest.mark.parametrize(("ours", "precision"), [(3, FINE), (4, FINE), (4, SMALL)], ids=["3", "4", "small"])
def test_reference_implementation_of_spz(
    tmp_path: Path, run_node: Callable[..., str], ours: spz.Version, precision: Precision
) -> None:
    """Adobe's library reads our files, writes each version that it supports, and reads the same numbers again.

    One process reads and writes all of them, since to start it takes longer.
    """
    for degree in range(4):
        spz.write_gaussians(tmp_path / f"ours_{degree}.spz", scene_of(degree), ours, precision)
    program = """
        import { readFileSync, writeFileSync } from "node:fs";
        import load from "@adobe/spz";
        const spz = await load();
        const [folder] = process.argv.slice(2);
        const read = (name) => {
            const cloud = spz.loadSpzFromBuffer(readFileSync(`${folder}/${name}`), {to: spz.CoordinateSystem.RDF});
            console.log("cloud" + JSON.stringify([name, Object.fromEntries(
                ["positions", "scales", "rotations", "colors", "sh"].map((part) => [part, Array.from(cloud[part])]))]));
            return cloud;
        };
        for (const degree of [0, 1, 2, 3]) {
            const ours = read(`ours_${degree}.spz`);
            for (const version of [2, 3, 4]) {
                const options = {version, from: spz.CoordinateSystem.RDF, sh1Bits: 5, shRestBits: 4};
                writeFileSync(`${folder}/theirs_${degree}_${version}.spz`, spz.saveSpzToBuffer(ours, options));
                read(`theirs_${degree}_${version}.spz`);
            }
        }
    """
    output = run_node(program, tmp_path)
    clouds = dict(json.loads(line[5:]) for line in output.splitlines() if line.startswith("cloud"))
    assert len(clouds) == 4 + 4 * 3
    for name, cloud in clouds.items():
        found = read_scene(tmp_path / name)
        np.testing.assert_allclose(np.reshape(cloud["positions"], (-1, 3)), found.means, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(np.reshape(cloud["scales"], (-1, 3)), found.log_scales, atol=1e-5, err_msg=name)
        np.testing.assert_allclose(np.reshape(cloud["colors"], (-1, 3)), found.sh[:, 0], atol=1e-5, err_msg=name)
        harmonics = np.reshape(cloud["sh"], found.sh[:, 1:].shape)
        np.testing.assert_allclose(harmonics, found.sh[:, 1:], atol=1e-5, err_msg=name)
        rotations = np.roll(np.reshape(cloud["rotations"], (-1, 4)), 1, axis=1)
        # Version 2 may give a little more than a length of 1, and takes roots of what float32 leaves near 0.
        unit = rotations / np.linalg.norm(rotations, axis=1, keepdims=True)
        np.testing.assert_allclose(unit, found.quaternions, atol=5e-4, err_msg=name)


@DEGREES
def test_turned_like_elsewhere(tmp_path: Path, splat_transform: Callable[..., None], scene: Gaussians) -> None:
    """Splat-transform rotates about axes left, up and forward: rotations about our x and y have the opposite sign."""
    from scipy.spatial.transform import Rotation

    scene.save(tmp_path / "ours.ply")
    splat_transform(tmp_path / "ours.ply", "-r", "20,-30,40", tmp_path / "theirs.ply")
    theirs = Gaussians.load(tmp_path / "theirs.ply")
    turned = rotated(scene, Rotation.from_euler("xyz", [-20, 30, 40], degrees=True).as_matrix())
    np.testing.assert_allclose(theirs.means, turned.means, atol=1e-4)
    np.testing.assert_allclose(theirs.sh, turned.sh, atol=1e-4)
    largest = covariances(scene).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(covariances(theirs) / largest, covariances(turned) / largest, atol=1e-4)
