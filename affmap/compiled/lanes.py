"""Vectors of eight floats for compiled loops: arithmetic, comparisons and memory.

A `Lanes` stands for a register of the processor. Loops that are written with it are as fast as the processor allows,
whereas loops over numbers are only if the compiler finds out how to vectorise them.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

WIDTH = 8
"""Floats of a vector."""

FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
INTS = ir.VectorType(ir.IntType(32), WIDTH)


class LanesType(types.Type):
    """The type of a vector in compiled code; outside of it there are none."""

    def __init__(self) -> None:
        """Name it."""
        super().__init__("Lanes")


Lanes = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, FLOATS)


def _register(symbol: Callable[..., Any], instruction: str) -> None:
    """Give an operator of Python a meaning for two vectors."""

    @infer_global(symbol)
    class _Signature(ConcreteTemplate):
        cases = [signature(Lanes, Lanes, Lanes)]

    @lower_builtin(symbol, Lanes, Lanes)
    def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)


for _symbol, _instruction in {
    operator.add: "fadd",
    operator.sub: "fsub",
    operator.mul: "fmul",
    operator.truediv: "fdiv",
}.items():
    _register(_symbol, _instruction)


def constant(kind: ir.VectorType, value: float) -> ir.Constant:
    """Return eight times the same number, of one of the two kinds above."""
    return ir.Constant(kind, [value] * WIDTH)


def _call(builder: Any, name: str, *args: Any) -> Any:
    """Call an intrinsic function of LLVM on vectors."""
    kind = ir.FunctionType(FLOATS, [FLOATS] * len(args))
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f32"), args)


def _address(context: Any, builder: Any, kind: Any, memory: Any, index: Any) -> Any:
    """The address of a number in a flat array, or behind a pointer."""
    if isinstance(kind, types.Array):
        memory = context.make_array(kind)(context, builder, memory).data
    return builder.gep(memory, [index])


def _place(context: Any, builder: Any, kind: Any, memory: Any, index: Any) -> Any:
    """The address of eight neighbours."""
    return builder.bitcast(_address(context, builder, kind, memory, index), FLOATS.as_pointer())


@intrinsic
def pointer(typing: Any, array: Any) -> Any:
    """Return the address of an array's first number.

    Unlike arrays, pointers cost nothing in tuples and calls. They keep nothing alive: see `keep`.
    """

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_array(array)(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), lower


@intrinsic
def keep(typing: Any, array: Any) -> Any:
    """Use an array, so that its memory is not freed before."""
    return types.none(array), lambda context, builder, sig, args: context.get_dummy_value()


def _splat(builder: Any, number: Any) -> Any:
    single = builder.insert_element(ir.Constant(FLOATS, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(single, single, ir.Constant(INTS, [0] * WIDTH))


@intrinsic
def splat(typing: Any, number: Any) -> Any:
    """The vector of eight times the same number (float32)."""
    return Lanes(types.float32), lambda context, builder, sig, args: _splat(builder, args[0])


@intrinsic
def broadcast(typing: Any, array: Any, index: Any) -> Any:
    """Return the vector of eight times the number at `index` of float32 numbers; nothing checks that it is there."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _splat(builder, builder.load(_address(context, builder, sig.args[0], *args)))

    return Lanes(array, types.intp), lower


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Eight neighbours in a flat array of float32, from `index` on; nothing checks that they are there."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, sig.args[0], *args), align=4)

    return Lanes(array, types.intp), lower


@intrinsic
def store(typing: Any, array: Any, index: Any, lanes: Any) -> Any:
    """Write a vector into a flat array of float32, from `index` on; nothing checks that there is room."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array, index, value = args
        builder.store(value, _place(context, builder, sig.args[0], array, index), align=4)
        return context.get_dummy_value()

    return types.none(array, types.intp, Lanes), lower


@intrinsic
def store_totals(typing: Any, array: Any, index: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Write the sums over each of four vectors into a flat array of float32, from `index` on."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def fold(one: Any, other: Any, first: list[int], second: list[int]) -> Any:
            masks = (ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places) for places in (first, second))
            return builder.fadd(*(builder.shuffle_vector(one, other, mask) for mask in masks))

        array, index, a, b, c, d = args
        even, odd = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
        low, high = fold(a, b, even, odd), fold(c, d, even, odd)
        both = fold(low, high, [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
        totals = fold(both, both, [0, 1, 2, 3], [4, 5, 6, 7])
        place = _place(context, builder, sig.args[0], array, index)
        builder.store(totals, builder.bitcast(place, totals.type.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.none(array, types.intp, Lanes, Lanes, Lanes, Lanes), lower


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once."""
    return Lanes(Lanes, Lanes, Lanes), lambda context, builder, sig, args: _call(builder, "fma", *args)


@intrinsic
def floor(typing: Any, lanes: Any) -> Any:
    """The next whole numbers below."""
    return Lanes(Lanes), lambda context, builder, sig, args: _call(builder, "floor", *args)


@intrinsic
def root(typing: Any, lanes: Any) -> Any:
    """Square roots."""
    return Lanes(Lanes), lambda context, builder, sig, args: _call(builder, "sqrt", *args)


@intrinsic
def at_most(typing: Any, lanes: Any, limit: Any) -> Any:
    """The smaller of a number and a limit; NaN stays NaN."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value, limit = args
        return builder.select(builder.fcmp_ordered("<", limit, value), limit, value)

    return Lanes(Lanes, Lanes), lower


@intrinsic
def at_least(typing: Any, lanes: Any, limit: Any) -> Any:
    """The larger of a number and a limit; NaN stays NaN."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value, limit = args
        return builder.select(builder.fcmp_ordered(">", limit, value), limit, value)

    return Lanes(Lanes, Lanes), lower


@intrinsic
def where_less(typing: Any, a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    """`then` where a < b, elsewhere (and where one is NaN) `otherwise`."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b, then, otherwise = args
        return builder.select(builder.fcmp_ordered("<", a, b), then, otherwise)

    return Lanes(Lanes, Lanes, Lanes, Lanes), lower


@intrinsic
def any_less(typing: Any, a: Any, b: Any) -> Any:
    """Whether a < b anywhere."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(builder.fcmp_ordered("<", *args), ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(Lanes, Lanes), lower


@intrinsic
def whole(typing: Any, lanes: Any, lane: Any) -> Any:
    """Return one of eight whole numbers as an integer."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = builder.extract_element(builder.fptosi(args[0], INTS), args[1])
        return builder.sext(number, ir.IntType(64))

    return types.intp(Lanes, types.intp), lower


@intrinsic
def spread(typing: Any, lanes: Any, lane: Any) -> Any:
    """Return the vector of eight times one of its numbers."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _splat(builder, builder.extract_element(*args))

    return Lanes(Lanes, types.intp), lower


@intrinsic
def transposed(typing: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any) -> Any:
    """Return the columns of the eight rows."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def mixed(one: Any, other: Any, places: list[int]) -> Any:
            return builder.shuffle_vector(one, other, ir.Constant(INTS, places))

        rows = list(args)
        for half, low, high in (  # blocks of 4, of 2 and of 1 change places
            (4, [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]),
            (2, [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]),
            (1, [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]),
        ):
            for row in range(WIDTH):
                if not row & half:
                    one, other = rows[row], rows[row + half]
                    rows[row], rows[row + half] = mixed(one, other, low), mixed(one, other, high)
        return context.make_tuple(builder, sig.return_type, rows)

    return types.UniTuple(Lanes, WIDTH)(*[Lanes] * WIDTH), lower
