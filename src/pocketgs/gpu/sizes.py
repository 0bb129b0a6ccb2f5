"""Sizes of buffers and dispatches as expressions, so that a description of passes fits any amount of data.

An expression combines named numbers with + - *, comparisons, `ceil_div(a, b)` and `max(a, b)` into an integer. It means
the same in Python and in JavaScript.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from functools import cache

Symbols = Mapping[str, int]
"""Named numbers, such as the number of items or the image width in pixels."""


def ceil_div(a: int, b: int) -> int:
    """A / b, rounded up."""
    return -(-a // b)


class _NoExpression(Exception):  # noqa: N818 - never leaves this file
    """Not an expression, or an unknown name."""


_OPERATORS: dict[type, Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Gt: operator.gt,
    ast.Lt: operator.lt,
}
_FUNCTIONS: dict[str, Callable[[int, int], int]] = {"ceil_div": ceil_div, "max": max}


def evaluate(expression: str, symbols: Symbols) -> int:
    """Evaluate an expression.

    Raises:
        ValueError: it is not an expression, or uses an unknown name.
    """
    try:
        return int(_value(_parse(expression), symbols))
    except (SyntaxError, _NoExpression) as error:
        expected = f"expected a number, one of {', '.join(symbols)}, or a sum of these"
        raise ValueError(f"{expression!r}: {expected}") from error


@cache
def _parse(expression: str) -> ast.expr:
    return ast.parse(expression, mode="eval").body


def _value(node: ast.expr, symbols: Symbols) -> int:
    match node:
        case ast.Constant(value=int(value)):
            return value
        case ast.Name(id=name) if name in symbols:
            return symbols[name]
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(left, symbols), _value(right, symbols))
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(left, symbols), _value(right, symbols))
        case ast.Call(func=ast.Name(id=name), args=[left, right]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](_value(left, symbols), _value(right, symbols))
    raise _NoExpression
