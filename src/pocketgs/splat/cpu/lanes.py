"""A vector of LANES float32 as a Numba type, so that kernels are explicitly vectorised.

LLVM legalises the vector for any processor (two or four NEON or SSE registers, one or two AVX registers). Arithmetic
operators work lane by lane and accept a number on either side; a comparison gives a mask for `select`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 16

_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_INTEGERS = ir.VectorType(ir.IntType(32), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)
# Allows LLVM to fuse a·b + c into one instruction, but not to reorder sums.
_FLAGS = ("contract",)

# Type hints of vectors and of masks: mypy cannot know Numba's types.
Floats = Any
Mask = Any


class _FloatsType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Float32x{LANES}")


class _MaskType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Mask{LANES}")


FLOATS = _FloatsType()
MASK = _MaskType()


@register_model(_FloatsType)
class _FloatsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, frontend_type: types.Type) -> None:
        super().__init__(manager, frontend_type, _FLOATS)


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, frontend_type: types.Type) -> None:
        super().__init__(manager, frontend_type, _BITS)


def _vector_pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = cgutils.create_struct_proxy(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _FLOATS.as_pointer())


@intrinsic
def load(typing_context: Any, array: Any, index: Any) -> Any:
    """LANES consecutive elements of a contiguous 1-D float32 array, from `index` on, unchecked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_vector_pointer(context, builder, signature.args[0], *arguments), align=4)

    return FLOATS(array, types.intp), generate


@intrinsic
def store(typing_context: Any, array: Any, index: Any, vector: Any) -> Any:
    """Write a vector to LANES consecutive elements of a contiguous 1-D float32 array, unchecked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _vector_pointer(context, builder, signature.args[0], arguments[0], arguments[1])
        builder.store(arguments[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, FLOATS), generate


@intrinsic
def prefetch(typing_context: Any, rows: Any, index: Any) -> Any:
    """Prefetch a row of a contiguous 2-D array; the processor does not foresee rows in random order."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0])
        row_bytes = builder.extract_value(array.strides, 0)
        address = builder.add(builder.ptrtoint(array.data, ir.IntType(64)), builder.mul(arguments[1], row_bytes))
        pointer = builder.inttoptr(address, ir.IntType(8).as_pointer())
        kind = [ir.Constant(ir.IntType(32), number) for number in (0, 3, 1)]
        function_type = ir.FunctionType(ir.VoidType(), [pointer.type, *(each.type for each in kind)])
        function = builder.module.declare_intrinsic("llvm.prefetch", [pointer.type], function_type)
        builder.call(function, [pointer, *kind])
        return context.get_dummy_value()

    return types.void(rows, types.intp), generate


@intrinsic
def broadcast(typing_context: Any, value: Any) -> Any:
    """A vector with the float32 `value` in all lanes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0])

    return FLOATS(types.float32), generate


def _spread(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(_FLOATS, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(_INTEGERS, [0] * LANES))


def constant(values: Sequence[float] | np.ndarray) -> Callable[[], Floats]:
    """A function for kernels, without arguments, that returns the vector of these LANES numbers."""
    numbers = [float(value) for value in np.asarray(values, dtype=np.float32)]

    @intrinsic
    def vector(typing_context: Any) -> Any:
        return FLOATS(), lambda context, builder, signature, arguments: ir.Constant(_FLOATS, numbers)

    return vector


def _define(function: Callable[..., Any], emit: Callable[[Any, Any, Any], Any], result: types.Type) -> None:
    """Let a function or an operator take two vectors, or a vector and a number; `emit(builder, left, right)` writes it.

    Kernels have thousands of these. Numba types and lowers a call of a builtin at once. Inlining an `overload` would
    rewrite the kernel each time: compiling the engine then takes one and a half times as long.
    """

    @type_callable(function)
    def typing(context: Any) -> Any:
        def types_of(left: Any, right: Any) -> Any:
            kinds = (left, right)
            takes = FLOATS in kinds and all(kind == FLOATS or isinstance(kind, types.Number) for kind in kinds)
            return result if takes else None

        return types_of

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pairs = zip(signature.args, arguments, strict=True)
        return emit(builder, *(_as_vector(context, builder, kind, value) for kind, value in pairs))

    for kinds in ((FLOATS, FLOATS), (FLOATS, types.Number), (types.Number, FLOATS)):
        lower_builtin(function, *kinds)(generate)


def _as_vector(context: Any, builder: Any, kind: types.Type, value: Any) -> Any:
    return value if kind == FLOATS else _spread(builder, context.cast(builder, value, kind, types.float32))


_define(operator.add, lambda b, x, y: b.fadd(x, y, flags=_FLAGS), FLOATS)
_define(operator.sub, lambda b, x, y: b.fsub(x, y, flags=_FLAGS), FLOATS)
_define(operator.mul, lambda b, x, y: b.fmul(x, y, flags=_FLAGS), FLOATS)
_define(operator.truediv, lambda b, x, y: b.fdiv(x, y, flags=_FLAGS), FLOATS)
_define(operator.ge, lambda b, x, y: b.fcmp_ordered(">=", x, y), MASK)
_define(operator.eq, lambda b, x, y: b.fcmp_ordered("==", x, y), MASK)
_define(operator.lt, lambda b, x, y: b.fcmp_ordered("<", x, y), MASK)
_define(max, lambda b, x, y: b.select(b.fcmp_ordered(">=", x, y), x, y), FLOATS)
_define(min, lambda b, x, y: b.select(b.fcmp_ordered("<", x, y), x, y), FLOATS)


@type_callable(operator.and_)
def _type_and(context: Any) -> Any:
    return lambda left, right: MASK if left == right == MASK else None


@lower_builtin(operator.and_, MASK, MASK)
def _and(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.and_(*arguments)


@intrinsic
def select(typing_context: Any, mask: Any, where_true: Any, where_false: Any) -> Any:
    """Lane by lane, `where_true` where the mask is true, otherwise `where_false`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    return FLOATS(MASK, FLOATS, FLOATS), generate


@intrinsic
def any_lane(typing_context: Any, mask: Any) -> Any:
    """Whether the mask is true in any lane."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(MASK), generate


@intrinsic
def sums(typing_context: Any, vectors: Any) -> Any:
    """Vector whose lane i is the sum of vector i's lanes, from a tuple of at most LANES vectors; other lanes are 0.

    Pairwise horizontal additions, level by level, take fewer instructions than separate sums.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        zero = ir.Constant(_FLOATS, None)
        level = [builder.extract_value(arguments[0], i) for i in range(len(vectors))]
        evens, odds = (ir.Constant(_INTEGERS, list(range(start, 2 * LANES, 2))) for start in (0, 1))
        width = LANES
        while width > 1:
            if len(level) % 2:
                level.append(zero)
            pairs = zip(level[::2], level[1::2], strict=True)
            level = [
                builder.fadd(builder.shuffle_vector(a, b, evens), builder.shuffle_vector(a, b, odds)) for a, b in pairs
            ]
            width //= 2
        return level[0]

    return FLOATS(vectors), generate


@intrinsic
def truncate(typing_context: Any, vector: Any) -> Any:
    """Each lane rounded towards zero, as a float."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.sitofp(builder.fptosi(arguments[0], _INTEGERS), _FLOATS)

    return FLOATS(FLOATS), generate


@intrinsic
def times_power_of_two(typing_context: Any, vector: Any, exponent: Any) -> Any:
    """Vector · 2^exponent for integral exponents, by adding to the exponent bits of normal numbers."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits = builder.bitcast(arguments[0], _INTEGERS)
        shift = builder.shl(builder.fptosi(arguments[1], _INTEGERS), ir.Constant(_INTEGERS, [23] * LANES))
        return builder.bitcast(builder.add(bits, shift), _FLOATS)

    return FLOATS(FLOATS, FLOATS), generate


@intrinsic
def magnitude(typing_context: Any, vector: Any) -> Any:
    """|x| lane by lane: clears the sign bit."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits = builder.bitcast(arguments[0], _INTEGERS)
        return builder.bitcast(builder.and_(bits, ir.Constant(_INTEGERS, [0x7FFFFFFF] * LANES)), _FLOATS)

    return FLOATS(FLOATS), generate


@intrinsic
def square_root(typing_context: Any, vector: Any) -> Any:
    """√x lane by lane."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function_type = ir.FunctionType(_FLOATS, [_FLOATS])
        function = cgutils.get_or_insert_function(builder.module, function_type, f"llvm.sqrt.v{LANES}f32")
        return builder.call(function, arguments)

    return FLOATS(FLOATS), generate
