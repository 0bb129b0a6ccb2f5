"""Files of sort-free scenes: `.ply` holds everything, `.pgs` what was rounded; broken ones are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attack.mutations import broken_header, broken_sections
from pocketgs.cli import main
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound
from pocketgs.scene.edits import rotated
from pocketgs.scene.formats import pgs
from pocketgs.scene.formats.pgs_coding import CODINGS
from pocketgs.scene.formats.pgs_rounding import on_grid, rounded
from pocketgs.scene.formats.pgs_sections import Section, join_sections, split_sections
from pocketgs.scene.formats.spz_precision import Detail
from pocketgs.scene.gaussians import PARAMETERS, SH_COEFFICIENTS, Gaussians
from pocketgs.sort_free.edits import edited
from pocketgs.sort_free.file import is_sort_free, read_sort_free, write_sort_free
from pocketgs.sort_free.forms import FORMS
from pocketgs.sort_free.pgs_file import KNOWN, STEPS, encode
from pocketgs.sort_free.scene import SortFreeScene, sort_free
from scene.formats.scenes import random_scene, scenes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("free")


def with_weights(gaussians: Gaussians, form: str, degree: int = 2, seed: int = 0) -> SortFreeScene:
    scene, rng = sort_free(gaussians, form, 3.7, degree), np.random.default_rng(seed)
    visibility_sh = scene.visibility_sh + rng.normal(0.0, 3.0, scene.visibility_sh.shape)
    return replace(
        scene,
        log_shared=scene.log_shared + rng.normal(size=scene.log_shared.shape),
        visibility_sh=visibility_sh.astype(np.float32),
    )


def rows_of(scene: SortFreeScene) -> np.ndarray:
    """All numbers of the Gaussians, in an order that does not depend on theirs."""
    parts = [getattr(scene.gaussians, name).reshape(len(scene), -1) for name in PARAMETERS]
    rows = np.concatenate([*parts, scene.visibility_sh], axis=1)
    return rows[np.lexsort(rows.T)]


@given(
    gaussians=scenes(),
    form=st.sampled_from(list(FORMS)),
    degree=st.integers(0, 3),
    seed=st.integers(0, 99),
    detail=st.sampled_from(["fine", "small"]),
)
@settings(max_examples=12)
def test_a_pgs_holds_what_was_rounded(
    folder: Path, gaussians: Gaussians, form: str, degree: int, seed: int, detail: Detail
) -> None:
    scene, path = with_weights(gaussians, form, degree, seed), folder / "scene.pgs"
    step = float(np.float32(STEPS[detail]))
    once = replace(
        scene, gaussians=rounded(gaussians, CODINGS[detail]), visibility_sh=on_grid(scene.visibility_sh, step)
    )
    for given_, expected in ((scene, once), (once, once)):
        write_sort_free(path, given_, detail)
        assert is_sort_free(path)
        found = read_sort_free(path)
        assert rows_of(found).tobytes() == rows_of(expected).tobytes()
        assert (found.form.name, found.unit, found.log_shared.tobytes()) == (form, 3.7, scene.log_shared.tobytes())
    assert np.abs(once.visibility_sh - scene.visibility_sh).max(initial=0.0) <= step / 2 + 1e-5


def test_readers_of_sorted_scenes_refuse_it(folder: Path) -> None:
    """Current readers explain the refusal; earlier ones refuse it too, since its sections must not be skipped."""
    path = folder / "free.pgs"
    write_sort_free(path, with_weights(random_scene(50, 1), "visibility"))
    with pytest.raises(PocketGSError, match="a scene that is drawn without sorting, expected one that is sorted"):
        Gaussians.load(path)
    with pytest.raises(PocketGSError, match="section 'weights' of type 1 is repeated or unknown to this version"):
        split_sections(path, path.read_bytes(), pgs.KNOWN)
    random_scene(50, 1).save(path)
    assert not is_sort_free(path)
    with pytest.raises(PocketGSError, match="section 'weights' is missing or too short, expected a sort-free scene"):
        read_sort_free(path)


@pytest.mark.parametrize(
    ("place", "new", "told"),
    [
        (0, b"magic".ljust(16, b"\0"), "form 'magic': not known, expected one of"),
        (16, b"\2", r"views of shape \(60, 2\), expected"),
        (17, b"\2", "of 40 bytes for 2 numbers"),
        (20, np.float32(0).tobytes(), "step 0"),
        (24, np.float64(np.nan).tobytes(), "unit nan and numbers"),
        (32, np.float64(700.0).tobytes(), "expected such that float32 can hold"),
    ],
)
def test_broken_fields_are_named(folder: Path, place: int, new: bytes, told: str) -> None:
    path = folder / "broken.pgs"
    parts = split_sections(path, encode(with_weights(random_scene(60, 0), "visibility")), KNOWN)
    fields = parts["weights"]
    parts["weights"] = fields[:place] + new + fields[place + len(new) :]
    kinds = dict(KNOWN)
    path.write_bytes(join_sections([Section(name, kinds[name], part) for name, part in parts.items()]))
    with pytest.raises(PocketGSError, match=told) as raised:
        read_sort_free(path)
    assert str(path) in str(raised.value)
    del parts["view"]
    parts["weights"] = fields
    path.write_bytes(join_sections([Section(name, kinds[name], part) for name, part in parts.items()]))
    with pytest.raises(PocketGSError, match="section 'view' is missing"):
        read_sort_free(path)


def test_broken_files_are_read_or_refused(folder: Path) -> None:
    """A right checksum before sections that are broken, and headers whose words are exchanged."""
    whole = [encode(with_weights(random_scene(60, 1), form)) for form in ("lc", "direct", "visibility")]
    ply = folder / "whole.ply"
    write_sort_free(ply, with_weights(random_scene(30, 1), "lc"))
    header = ply.read_bytes()
    outcomes = set()
    with memory_bound(100):
        for number in range(300):
            rng = Random(number)
            path = folder / ("broken.ply" if number % 4 == 0 else "broken.pgs")
            content = broken_header(rng, header) if number % 4 == 0 else broken_sections(rng, whole[number % 3])
            path.write_bytes(content)
            try:
                found = read_sort_free(path)
                assert np.isfinite(found.unit)
                outcomes.add("read")
            except PocketGSError as error:
                outcomes.add("refused" if 0 < len(str(error)) < 2000 else str(error))
    assert outcomes == {"read", "refused"}


def test_weights_turn_with_the_scene() -> None:
    scene = with_weights(random_scene(40, 1), "lc", 3)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = edited(scene, lambda gaussians: rotated(gaussians, turn).select(np.arange(5, 40)), 2.0)
    assert (len(found), found.unit) == (35, 7.4)
    # Of degree 1, the coefficients of -y, z and -x turn as a vector does.
    x, y = -scene.visibility_sh[5:, 3], -scene.visibility_sh[5:, 1]
    np.testing.assert_allclose(
        found.visibility_sh[:, [1, 2, 3]], np.stack([-x, scene.visibility_sh[5:, 2], y], axis=1), atol=1e-5
    )
    np.testing.assert_allclose(found.visibility_sh[:, 0], scene.visibility_sh[5:, 0], atol=1e-6)
    assert edited(with_weights(random_scene(9, 0), "direct"), lambda gaussians: gaussians).visibility_sh.shape == (9, 0)


def test_the_commands(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = with_weights(random_scene(200, 2), "visibility", 1)
    first, small, back, sorted_ = (str(folder / name) for name in ("a.ply", "b.pgs", "c.ply", "d.spz"))
    write_sort_free(Path(first), scene)
    main(["convert", first, small, "--sh-degree", "1", "--scale", "2", "--rotate", "0", "0", "90"])
    main(["convert", small, back])
    found = read_sort_free(Path(back))
    assert (len(found), found.unit, found.gaussians.sh.shape[1]) == (200, 7.4, SH_COEFFICIENTS[1])
    assert rows_of(found).tobytes() == rows_of(read_sort_free(Path(small))).tobytes()
    capsys.readouterr()
    main(["info", small])
    told = capsys.readouterr().out
    assert "200 Gaussians" in told
    assert "compositor visibility: unit 7.4, sigma" in told
    for arguments, words in (
        (["convert", small, sorted_], "expected one that ends in .ply or .pgs"),
        (["compress", small, "--output", str(folder / "e.pgs")], "drawn without sorting, expected one that is sorted"),
    ):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 2
        assert words in " ".join(capsys.readouterr().err.split())
    assert not Path(sorted_).exists()
