"""A short run of the attack on the readers; `readers.py` says how to run a long one."""

from __future__ import annotations

from pathlib import Path

from attack.readers import attack, failures_of


def test_broken_files_are_read_or_refused(tmp_path: Path) -> None:
    outcomes = attack(tmp_path, cases=120, seed=0)
    assert failures_of(outcomes) == []
    assert len(outcomes) == 120
    assert {outcome.ending for outcome in outcomes} == {"read", "refused"}, "some of what is broken can still be read"
