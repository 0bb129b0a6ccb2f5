"""The dictionary of intermediate results behaves like one with all values computed."""

from __future__ import annotations

import pytest

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


def test_what_is_shown_or_taken_out_is_computed() -> None:
    assert repr(meta()) == "{'width': 50, 'ids': 7, 'offsets': 8}"
    found = meta()
    assert [found.popitem() for _ in range(3)] == [("offsets", 8), ("ids", 7), ("width", 50)]
    with pytest.raises(KeyError):
        found.popitem()
    found = meta()
    found.clear()
    assert found.get("ids") is None


def test_frameworks_make_one_of_the_same_type_from_pairs() -> None:
    found = meta()
    made = type(found)((name, value + 1) for name, value in found.items())
    assert made == {"width": 51, "ids": 8, "offsets": 9}
    assert Meta() == {}
