"""PocketGS' own format: what it rounds, that it rounds once, and that broken files are refused."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attack.mutations import broken_sections
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound
from pocketgs.scene.formats import pgs, read_scene
from pocketgs.scene.formats.pgs_coding import DEFAULT, FINE, Coding
from pocketgs.scene.formats.pgs_rounding import GROUPS, rounded
from pocketgs.scene.formats.pgs_sections import OPTIONAL, Section, join_sections, section_names, split_sections
from pocketgs.scene.formats.range_coder import RangeDecoder, RangeEncoder, new_models
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from scene.formats.scenes import covariances, load_or_refuse, opacity_error, random_scene, scenes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pgs")


def rows_of(scene: Gaussians) -> np.ndarray:
    """All numbers of a scene, in an order that does not depend on that of its Gaussians."""
    rows = np.concatenate([getattr(scene, name).reshape(len(scene), -1) for name in PARAMETERS], axis=1)
    return rows[np.lexsort(rows.T)]


def read_back(folder: Path, scene: Gaussians, coding: Coding = DEFAULT) -> Gaussians:
    pgs.write_gaussians(folder / "scene.pgs", scene, coding)
    return pgs.read_gaussians(folder / "scene.pgs")


@given(
    values=st.lists(st.one_of(st.integers(-3, 3), st.integers(1 - 2**24, 2**24 - 1)), min_size=1, max_size=80),
    seed=st.integers(0, 99),
)
@settings(max_examples=50)
def test_columns_are_read_as_written(values: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    contexts = rng.integers(0, 3, len(values))
    neighbours = rng.integers(-1, np.maximum(np.arange(len(values)), 1), (2, len(values))).T
    neighbours[(neighbours < 0).any(axis=1) | (np.arange(len(values)) == 0)] = -1
    coder = RangeEncoder()
    coder.column(np.array(values), contexts, new_models(3), neighbours)
    coder.column(np.array(values[::-1]), contexts, new_models(3))
    decoder = RangeDecoder(coder.finish())
    assert decoder.column(contexts, new_models(3), neighbours).tolist() == values
    assert decoder.column(contexts, new_models(3)).tolist() == values[::-1]


@given(scene=scenes())
@settings(max_examples=40)
def test_a_file_holds_what_was_rounded(folder: Path, scene: Gaussians) -> None:
    once = rounded(scene)
    assert rows_of(rounded(once)).tobytes() == rows_of(once).tobytes()
    assert rows_of(read_back(folder, scene)).tobytes() == rows_of(once).tobytes()
    assert rows_of(read_back(folder, once)).tobytes() == rows_of(once).tobytes()
    size = np.exp(np.median(scene.log_scales, axis=1))[:, None]
    finest = np.abs(scene.means).max() * 2.0**-20
    assert (np.abs(once.means - scene.means) <= np.maximum(size * DEFAULT.position / 2, finest) * 1.01).all()
    steps = DEFAULT.log_scale, DEFAULT.colour
    assert np.abs(np.sort(once.log_scales) - np.sort(scene.log_scales)).max() <= steps[0] / 2 + 1e-5
    assert np.abs(once.sh[:, 0] - scene.sh[:, 0]).max() <= steps[1] / 2 + 1e-5
    assert opacity_error(once, scene) <= DEFAULT.opacity / 8 + 1e-4


def test_shapes_stay_about_the_same() -> None:
    scene = random_scene(2000, 0)
    scene.log_scales[:] = np.random.default_rng(0).normal(-2, 0.8, scene.log_scales.shape)
    once = rounded(scene)
    apart = np.linalg.norm(covariances(once) - covariances(scene), axis=(1, 2))
    relative = apart / np.linalg.norm(covariances(scene), axis=(1, 2))
    assert np.median(relative) < 0.15
    assert relative.max() < 0.5


def test_groups_may_be_rounded_one_by_one_with_training_in_between(folder: Path) -> None:
    scene, rng = random_scene(900, 2), np.random.default_rng(1)
    done: list[str] = []
    for group in GROUPS:
        scene = rounded(scene, DEFAULT, [group])
        done.append(group)
        parts = {name: getattr(scene, name).copy() for name in PARAMETERS}
        for name in set(PARAMETERS[:4]) - set(done):
            parts[name] += rng.normal(0, 0.05, parts[name].shape)
        parts["sh"][:, :1] += 0.05 * ("sh_dc" not in done)
        parts["sh"][:, 1:] += 0.05 * ("sh_rest" not in done)
        scene = Gaussians(**parts)
    assert rows_of(read_back(folder, scene)).tobytes() == rows_of(scene).tobytes()


def test_rotations_stay_on_the_grid_when_training_normalises_them() -> None:
    once = rounded(random_scene(20_000, 0), DEFAULT)
    length = np.linalg.norm(once.quaternions, axis=1, keepdims=True)
    trained = dataclasses.replace(once, quaternions=np.nextafter(once.quaternions / length, np.float32(2)))
    assert (trained.quaternions != once.quaternions).any(axis=1).mean() > 0.5
    assert rows_of(rounded(trained, DEFAULT)).tobytes() == rows_of(once).tobytes()


def test_other_steps_and_importance(folder: Path) -> None:
    scene = random_scene(600, 3)
    coding = dataclasses.replace(DEFAULT, log_scale=0.1, harmonics=0.1, entries=300)
    first = rounded(scene, coding)
    assert rows_of(read_back(folder, scene, coding)).tobytes() == rows_of(first).tobytes()
    assert len(np.unique(first.sh[:, 1:].reshape(600, -1), axis=0)) <= 300
    weights = np.where(np.arange(600) < 200, 1000.0, 1.0)
    second = rounded(scene, coding, ["sh_rest"], weights)
    errors = [np.square(each.sh[:200, 1:] - scene.sh[:200, 1:]).mean() for each in (first, second)]
    assert errors[1] < errors[0]


def test_fine(folder: Path) -> None:
    scene = random_scene(20_000, 1, extent=1.0)
    fine = rounded(scene, FINE)
    assert np.abs(fine.sh[:, 1:] - scene.sh[:, 1:]).max() <= FINE.harmonics / 2 + 1e-6
    assert rows_of(rounded(fine, FINE)).tobytes() == rows_of(fine).tobytes()
    assert rows_of(read_back(folder, scene, FINE)).tobytes() == rows_of(fine).tobytes()


def test_a_coordinate_that_rounding_would_make_infinite() -> None:
    scene = random_scene(20, 0)
    scene.means[0] = np.finfo(np.float32).max
    with pytest.raises(PocketGSError, match=r"a coordinate of 3\.4e\+38, expected at most 1\.7e\+38 in a \.pgs"):
        pgs.encode(scene)


def test_sections(folder: Path) -> None:
    path = folder / "scene.pgs"
    scene = random_scene(600, 1)
    parts = split_sections(path, pgs.encode(scene), pgs.KNOWN)
    sections = [Section(name, kind, parts[name]) for name, kind in sorted(pgs.KNOWN)]
    path.write_bytes(join_sections([*sections, Section("phi", 9, b"later", OPTIONAL)]))
    assert rows_of(read_scene(path)).tobytes() == rows_of(rounded(scene)).tobytes()
    for wrong, told in (
        ([*sections, Section("phi", 9, b"later")], "section 'phi' of type 9"),
        ([*sections, sections[0]], "repeated or unknown"),
        (sections[1:], "section 'codebook' is missing"),
    ):
        path.write_bytes(join_sections(wrong))
        with pytest.raises(PocketGSError, match=told):
            read_scene(path)
    content = bytearray(join_sections(sections))
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(PocketGSError, match="checksum"):
        read_scene(path)


@pytest.mark.parametrize(("count", "told"), [(2**24, "MB of memory"), (2**24 + 1, "expected at most 16,777,216 in")])
def test_a_count_that_the_file_states_is_no_reason_to_allocate(folder: Path, count: int, told: str) -> None:
    path = folder / "bomb.pgs"
    parts = split_sections(path, pgs.encode(random_scene(600, 1)), pgs.KNOWN)
    parts["scene"] = count.to_bytes(4, "little") + parts["scene"][4:]
    path.write_bytes(join_sections([Section(name, kind, parts[name]) for name, kind in sorted(pgs.KNOWN)]))
    with pytest.raises(PocketGSError, match=told):
        read_scene(path)


def test_more_gaussians_than_a_number_can_count_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pgs, "MAX_NUMBER", 49)
    with pytest.raises(PocketGSError, match=r"50 Gaussians, expected at most 49 in a \.pgs"):
        pgs.encode(random_scene(50, 1))


@pytest.mark.parametrize(
    ("count", "coding", "has_book"), [(600, DEFAULT, True), (60, DEFAULT, False), (600, FINE, False)]
)
def test_there_is_a_codebook_only_where_it_saves_bytes(
    folder: Path, count: int, coding: Coding, has_book: bool
) -> None:
    scene = random_scene(count, 3)
    assert ("codebook" in split_sections(folder, pgs.encode(scene, coding), pgs.KNOWN)) == has_book
    assert rows_of(read_back(folder, scene, coding)).tobytes() == rows_of(rounded(scene, coding)).tobytes()


def test_broken_behind_a_right_checksum(folder: Path) -> None:
    without_and_with_book = [pgs.encode(random_scene(count, 1)) for count in (60, 600)]
    path = folder / "broken.pgs"
    with memory_bound(100):
        for number in range(200):
            path.write_bytes(broken_sections(Random(number), without_and_with_book[number % 2]))
            load_or_refuse(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_named_pipe_is_refused_unread(tmp_path: Path) -> None:
    """Opening one would wait for a writer; here there is one, so that a reader that opens it fails the test instead."""
    path = tmp_path / "scene.pgs"
    os.mkfifo(path)
    pipe = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    try:
        written = pgs.encode(random_scene(3, 0))
        os.write(pipe, written)
        with pytest.raises(PocketGSError, match=r"no such file"):
            pgs.read_gaussians(path)
        assert os.read(pipe, 2 * len(written)) == written
        os.write(pipe, written)
        assert section_names(path) == set()
    finally:
        os.close(pipe)
