"""The dictionary of intermediate results behaves like one with all values computed."""

from __future__ import annotations

from pocketgs.torch.meta import Meta


def meta() -> Meta:
    return Meta({"width": 50}, {("ids", "offsets"): lambda: (7, 8)})


def test_update_replaces_values_that_were_not_computed_yet() -> None:
    found = meta()
    found.update({"ids": 1}, height=40)
    found |= {"more": 3}
    assert found.copy() == {"width": 50, "ids": 1, "offsets": 8, "height": 40, "more": 3}


def test_setdefault_computes_a_value_rather_than_returning_none() -> None:
    found = meta()
    assert (found.setdefault("ids", 1), found.setdefault("more", 3)) == (7, 3)


def test_equality_compares_computed_values() -> None:
    plain = {"width": 50, "ids": 7, "offsets": 8}
    assert meta() == plain
    assert plain == meta()
    assert meta() == meta()
    assert meta() != plain | {"ids": None}


def test_a_deleted_value_does_not_come_back() -> None:
    found = meta()
    del found["ids"]
    assert found["offsets"] == 8
    assert set(found) == {"width", "offsets"}
