"""Vectors of eight floats for compiled loops: arithmetic, memory, and the few functions that models need.

A `Lanes` stands for a register of the processor. Loops that are written with it are as fast as the processor allows,
whereas loops over numbers are only if the compiler finds out how to vectorise them.
"""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from affmap.compiled.jit import inlined

WIDTH = 8
"""Floats of a vector."""

_FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
_INTS = ir.VectorType(ir.IntType(32), WIDTH)


class LanesType(types.Type):
    """The type of a vector in compiled code; outside of it there are none."""

    def __init__(self) -> None:
        """Name it."""
        super().__init__("Lanes")


Lanes = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, _FLOATS)


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


def _constant(kind: ir.VectorType, value: float) -> ir.Constant:
    return ir.Constant(kind, [value] * WIDTH)


def _call(builder: Any, name: str, *args: Any) -> Any:
    """Call an intrinsic function of LLVM on vectors."""
    kind = ir.FunctionType(_FLOATS, [_FLOATS] * len(args))
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f32"), args)


def _address(context: Any, builder: Any, kind: Any, memory: Any, index: Any) -> Any:
    """The address of a number in a flat array, or behind a pointer."""
    if isinstance(kind, types.Array):
        memory = context.make_array(kind)(context, builder, memory).data
    return builder.gep(memory, [index])


def _place(context: Any, builder: Any, kind: Any, memory: Any, index: Any) -> Any:
    """The address of eight neighbours."""
    return builder.bitcast(_address(context, builder, kind, memory, index), _FLOATS.as_pointer())


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
    """Use an array, so that its memory is not given back before."""
    return types.none(array), lambda context, builder, sig, args: context.get_dummy_value()


def _splat(builder: Any, number: Any) -> Any:
    single = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(single, single, ir.Constant(_INTS, [0] * WIDTH))


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
def _exponent(typing: Any, lanes: Any) -> Any:
    """Return k of x = 2^k m with m in [sqrt(1/2), sqrt(2)), from the bits of x."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        above = builder.sub(builder.bitcast(args[0], _INTS), _constant(_INTS, 0x3F3504F3))  # bits of sqrt(1/2)
        return builder.sitofp(builder.ashr(above, _constant(_INTS, 23)), _FLOATS)

    return Lanes(Lanes), lower


@intrinsic
def _mantissa(typing: Any, lanes: Any, exponent: Any) -> Any:
    """Return m of x = 2^k m, for x and k."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        shift = builder.shl(builder.fptosi(args[1], _INTS), _constant(_INTS, 23))
        return builder.bitcast(builder.sub(builder.bitcast(args[0], _INTS), shift), _FLOATS)

    return Lanes(Lanes, Lanes), lower


@intrinsic
def _add_exponent(typing: Any, lanes: Any, shifted: Any) -> Any:
    """Return x 2^n for x and 3 * 2^22 + n, where that is a normal number: n is added to the exponent's bits."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits, exponent = (builder.bitcast(arg, _INTS) for arg in args)
        return builder.bitcast(builder.add(bits, builder.shl(exponent, _constant(_INTS, 23))), _FLOATS)

    return Lanes(Lanes, Lanes), lower


@inlined
def exp2(x: Any) -> Any:
    """2 to the power of each number, to 1e-7 of it; 0 below 2^-125, infinity above 2^126."""
    low, high = splat(np.float32(-125)), splat(np.float32(126))
    power = _exp2(at_least(at_most(x, high), low))
    power = where_less(x, low, splat(np.float32(0)), power)
    return where_less(high, x, splat(np.float32(np.inf)), power)


@inlined
def _exp2(x: Any) -> Any:
    """The same from -125 to 126."""
    magic = splat(np.float32(3 * 2**22))  # a float of this size has no digits behind the point
    shifted = x + magic
    part = x - (shifted - magic)
    # Minimax polynomial on [-1/2, 1/2].
    result = splat(np.float32(1.3276466800e-03))
    result = fma(result, part, splat(np.float32(9.6755412930e-03)))
    result = fma(result, part, splat(np.float32(5.5507132896e-02)))
    result = fma(result, part, splat(np.float32(2.4022119725e-01)))
    result = fma(result, part, splat(np.float32(6.9314696705e-01)))
    result = fma(result, part, splat(np.float32(1.0)))
    return _add_exponent(result, shifted)


@inlined
def log(x: Any) -> Any:
    """Natural logarithms of finite numbers, to 1e-7; minus infinity below the smallest normal number."""
    exponent = _exponent(x)
    f = _mantissa(x, exponent) - splat(np.float32(1))
    # (log(1 + f) - f + f^2 / 2) / f^3, minimax polynomial on [sqrt(1/2) - 1, sqrt(2) - 1].
    result = splat(np.float32(-7.8595458752e-02))
    result = fma(result, f, splat(np.float32(1.2881622394e-01)))
    result = fma(result, f, splat(np.float32(-1.3128767629e-01)))
    result = fma(result, f, splat(np.float32(1.4181196114e-01)))
    result = fma(result, f, splat(np.float32(-1.6624553145e-01)))
    result = fma(result, f, splat(np.float32(2.0002286084e-01)))
    result = fma(result, f, splat(np.float32(-2.5000810428e-01)))
    result = fma(result, f, splat(np.float32(3.3333316727e-01)))
    square = f * f
    result = fma(result * f, square, fma(square, splat(np.float32(-0.5)), f))
    result = fma(exponent, splat(np.float32(0.6931471805599453)), result)
    tiny = splat(np.float32(1.1754944e-38))
    return where_less(x, tiny, splat(np.float32(-np.inf)), result)


@intrinsic
def whole(typing: Any, lanes: Any, lane: Any) -> Any:
    """Return one of eight whole numbers as an integer."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = builder.extract_element(builder.fptosi(args[0], _INTS), args[1])
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
            return builder.shuffle_vector(one, other, ir.Constant(_INTS, places))

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


@inlined
def sigmoids(a: Any, b: Any, c: Any, d: Any) -> Any:
    """1 / (1 + 2^x) of four vectors, with a single division; 2^-30 for what is less."""
    a, b, c, d = _one_and_power(a), _one_and_power(b), _one_and_power(c), _one_and_power(d)
    ab, cd = a * b, c * d
    inverse = splat(np.float32(1)) / (ab * cd)  # at most 2^120
    ab, cd = inverse * cd, inverse * ab
    return ab * b, ab * a, cd * d, cd * c


@inlined
def sigmoid(x: Any) -> Any:
    """1 / (1 + 2^x); 2^-30 for what is less."""
    return splat(np.float32(1)) / _one_and_power(x)


@inlined
def _one_and_power(x: Any) -> Any:
    return splat(np.float32(1)) + _exp2(at_least(at_most(x, splat(np.float32(30))), splat(np.float32(-125))))


@inlined
def tanh(x: Any) -> Any:
    """Hyperbolic tangents, to 1e-7."""
    one, two = splat(np.float32(1)), splat(np.float32(2))
    return one - two / (one + exp2(x * splat(np.float32(2.8853900817779268))))  # 2 / log(2)
