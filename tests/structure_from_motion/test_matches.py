"""Matching in processes side by side: what is found, and what happens if one of them fails."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import Image

from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion import matches
from pocketgs.structure_from_motion.photographs import Photograph, read_photographs
from pocketgs.structure_from_motion.process import run_side_by_side

SHIFT = 8
"""Pixels between two photographs."""


@pytest.fixture
def photographs(tmp_path: Path) -> list[Photograph]:
    """Seven photographs that are taken from a moving window over a texture, and a blank one."""
    folder, workspace = tmp_path / "photographs", tmp_path / "workspace"
    folder.mkdir()
    workspace.mkdir()
    texture = np.asarray(Image.effect_noise((60, 60), 120).resize((480, 480), Image.Resampling.BICUBIC))
    for number in range(7):
        window = texture[:, number * SHIFT : number * SHIFT + 320]
        Image.fromarray(window).convert("RGB").save(folder / f"# {number} (1).png")
    Image.new("RGB", (320, 480), "grey").save(folder / "blank.png")
    return read_photographs(folder, tmp_path / "none", workspace, 480, 2, lambda done, of: None)


def found(files: list[str]) -> dict[tuple[str, str], np.ndarray]:
    """Matches by pair of names."""
    by_pair = {}
    for file in files:
        with np.load(file) as stored:
            names = zip(stored["first"].tolist(), stored["second"].tolist(), strict=True)
            rows = np.split(stored["matches"], np.cumsum(stored["counts"])[:-1])
            by_pair |= dict(zip(names, rows, strict=False))
    return by_pair


def test_any_number_of_processes_finds_the_same_matches(
    photographs: list[Photograph], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = list(combinations(sorted(photograph.name for photograph in photographs), 2))
    monkeypatch.setattr(matches, "PAIRS_PER_PROCESS", 1)
    answers = []
    for processes in (1, 3):
        monkeypatch.setattr(matches, "usable_cores", lambda processes=processes: processes)
        counts: list[tuple[int, int]] = []
        files = matches.match(
            photographs, pairs, tmp_path / "workspace", lambda done, of, counts=counts: counts.append((done, of))
        )
        assert len(files) == processes
        assert counts == sorted(counts)
        assert counts[-1] == (len(pairs), len(pairs))
        answers.append(found(files))
    one, three = answers
    assert set(one) == {pair for pair in pairs if "blank.png" not in pair}
    assert one.keys() == three.keys()
    for pair, rows in one.items():
        np.testing.assert_array_equal(rows, three[pair])
    keypoints = {photograph.name: np.load(photograph.file)["keypoints"][:, :2] for photograph in photographs}
    for (first, second), rows in one.items():
        moved = keypoints[first][rows[:, 0]] - keypoints[second][rows[:, 1]]
        steps = int(second.split()[1]) - int(first.split()[1])
        right = np.abs(moved - [steps * SHIFT, 0]).max(axis=1) < 1
        assert right.sum() > 100
        assert right.mean() > 0.9


def test_photographs_that_share_nothing_have_no_matches(photographs: list[Photograph], tmp_path: Path) -> None:
    pairs = [(photographs[0].name, "blank.png")]
    assert found(matches.match(photographs, pairs, tmp_path / "workspace", lambda done, of: None)) == {}


def test_a_process_that_fails_stops_the_others(photographs: list[Photograph], tmp_path: Path) -> None:
    features = {photograph.name: str(photograph.file) for photograph in photographs}
    pairs = list(combinations(sorted(features), 2))
    jobs = [
        {
            "database": str(tmp_path / f"{number}.db"),
            "features": features if number else dict.fromkeys(features, str(tmp_path / "none.npz")),
            "pairs": pairs,
            "matches": str(tmp_path / f"{number}.npz"),
        }
        for number in range(3)
    ]
    with pytest.raises(PocketGSError, match=r"^COLMAP failed \(FileNotFoundError: .+none\.npz'\)$"):
        run_side_by_side("matching", jobs, tmp_path, lambda done: None)
    assert not [child for child in psutil.Process().children() if "matching" in " ".join(child.cmdline())]
