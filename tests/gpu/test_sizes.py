"""Sizes as expressions."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.gpu.sizes import ceil_div, evaluate


@given(st.integers(0, 10**7), st.integers(1, 10**4))
def test_expressions_have_their_values(a: int, b: int) -> None:
    symbols = {"a": a, "b": b}
    assert evaluate("a", symbols) == a
    assert evaluate("36 * a - 2 * (b + 1)", symbols) == 36 * a - 2 * (b + 1)
    assert evaluate("max(a, b) + 0", symbols) == max(a, b)
    assert evaluate("ceil_div(a, b)", symbols) == (a // b if a % b == 0 else a // b + 1)
    assert evaluate("a > b", symbols) == int(a > b)
    assert evaluate("a * 2 < b", symbols) == int(a * 2 < b)
    assert evaluate("ceil_div(a, 8) * ceil_div(b, 8)", symbols) == ceil_div(a, 8) * ceil_div(b, 8)


@pytest.mark.parametrize(
    "expression",
    ["c", "a / 2", "1.5 * a", "-a", "min(a, a)", "max(a)", "a.b", "a if a else 1", "'a'", "a > 1 > 0", "1 +"],
)
def test_what_is_not_such_an_expression_is_refused(expression: str) -> None:
    with pytest.raises(ValueError, match=r"expected a number, one of a"):
        evaluate(expression, {"a": 3})
