"""Powers, logarithms and the activation functions of models, for vectors of eight floats.

Minimax polynomials, without the tables and branches of a library: errors are near those of rounding.
"""

from typing import Any

import numpy as np
from numba.extending import intrinsic

from affmap.compiled.jit import inlined
from affmap.compiled.lanes import (
    FLOATS,
    INTS,
    Lanes,
    any_less,
    at_least,
    at_most,
    constant,
    fma,
    root,
    splat,
    where_less,
)


@intrinsic
def _add_exponent(typing: Any, lanes: Any, shifted: Any) -> Any:
    """Return x 2^n for x and 3 * 2^22 + n, where that is a normal number: n is added to the exponent's bits."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits, exponent = (builder.bitcast(arg, INTS) for arg in args)
        return builder.bitcast(builder.add(bits, builder.shl(exponent, constant(INTS, 23))), FLOATS)

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
    """2 to the power of each number from -125 to 126, to 1e-7 of it."""
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


@intrinsic
def _exponent(typing: Any, lanes: Any) -> Any:
    """Return k of x = 2^k m with m in [sqrt(1/2), sqrt(2)), from the bits of x."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        above = builder.sub(builder.bitcast(args[0], INTS), constant(INTS, 0x3F3504F3))  # bits of sqrt(1/2)
        return builder.sitofp(builder.ashr(above, constant(INTS, 23)), FLOATS)

    return Lanes(Lanes), lower


@intrinsic
def _mantissa(typing: Any, lanes: Any, exponent: Any) -> Any:
    """Return m of x = 2^k m, for x and k."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        shift = builder.shl(builder.fptosi(args[1], INTS), constant(INTS, 23))
        return builder.bitcast(builder.sub(builder.bitcast(args[0], INTS), shift), FLOATS)

    return Lanes(Lanes, Lanes), lower


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


@inlined
def sigmoid(x: Any) -> Any:
    """1 / (1 + 2^x), at least 2^-30."""
    return splat(np.float32(1)) / _one_and_power(x)


@inlined
def sigmoids(a: Any, b: Any, c: Any, d: Any) -> Any:
    """1 / (1 + 2^x) of four vectors, at least 2^-30, with a single division."""
    a, b, c, d = _one_and_power(a), _one_and_power(b), _one_and_power(c), _one_and_power(d)
    ab, cd = a * b, c * d
    inverse = splat(np.float32(1)) / (ab * cd)  # at most 2^120
    ab, cd = inverse * cd, inverse * ab
    return ab * b, ab * a, cd * d, cd * c


@inlined
def _one_and_power(x: Any) -> Any:
    return splat(np.float32(1)) + _exp2(at_least(at_most(x, splat(np.float32(30))), splat(np.float32(-125))))


@inlined
def tanh(x: Any) -> Any:
    """Hyperbolic tangents, to 1e-7."""
    one, two = splat(np.float32(1)), splat(np.float32(2))
    return one - two / (one + exp2(x * splat(np.float32(2.8853900817779268))))  # 2 / log(2)


@inlined
def erf(x: Any) -> Any:
    """The error function, to 4e-7."""
    x = at_most(at_least(x, splat(np.float32(-3.9))), splat(np.float32(3.9)))
    z = x * x
    # x P(x^2) / Q(x^2), fitted on [-3.9, 3.9].
    p = fma(splat(np.float32(2.050398127e-06)), z, splat(np.float32(2.874558768e-04)))
    p = fma(p, z, splat(np.float32(3.836815166e-03)))
    p = fma(p, z, splat(np.float32(5.296673056e-02)))
    p = fma(p, z, splat(np.float32(1.919395882e-01)))
    p = fma(p, z, splat(np.float32(1.128379032e00)))
    q = fma(splat(np.float32(3.823078210e-05)), z, splat(np.float32(1.181719637e-03)))
    q = fma(q, z, splat(np.float32(1.510908240e-02)))
    q = fma(q, z, splat(np.float32(1.147576140e-01)))
    q = fma(q, z, splat(np.float32(5.034338098e-01)))
    q = fma(q, z, splat(np.float32(1)))
    return at_most(at_least(x * p / q, splat(np.float32(-1))), splat(np.float32(1)))


@inlined
def erf_inverse(x: Any) -> Any:
    """Return z with erf(z) = x, to 2e-7 of it; +-6 for +-1."""
    one = splat(np.float32(1))
    w = splat(np.float32(0)) - log((one - x) * (one + x))
    # x P(w), fitted for w below 5.
    near = w - splat(np.float32(2.5))
    p = fma(splat(np.float32(2.853490408e-08)), near, splat(np.float32(3.437272122e-07)))
    p = fma(p, near, splat(np.float32(-3.528860918e-06)))
    p = fma(p, near, splat(np.float32(-4.396782912e-06)))
    p = fma(p, near, splat(np.float32(2.186021990e-04)))
    p = fma(p, near, splat(np.float32(-1.253707510e-03)))
    p = fma(p, near, splat(np.float32(-4.177707750e-03)))
    p = fma(p, near, splat(np.float32(2.466407261e-01)))
    p = fma(p, near, splat(np.float32(1.501409422e00)))
    limit = splat(np.float32(5))
    if any_less(limit, w):  # seldom
        p = where_less(limit, w, _far(w), p)
    return x * p


@inlined
def _far(w: Any) -> Any:
    """The ratio of z and erf(z) for w = -log(1 - erf(z)^2) above 5; 6 from 17 on."""
    far = root(at_most(w, splat(np.float32(17)))) - splat(np.float32(3))
    q = fma(splat(np.float32(-1.398443167e-04)), far, splat(np.float32(6.771667347e-05)))
    q = fma(q, far, splat(np.float32(1.264330475e-03)))
    q = fma(q, far, splat(np.float32(-3.641157543e-03)))
    q = fma(q, far, splat(np.float32(5.778780252e-03)))
    q = fma(q, far, splat(np.float32(-7.630494019e-03)))
    q = fma(q, far, splat(np.float32(9.432902130e-03)))
    q = fma(q, far, splat(np.float32(1.001674481e00)))
    q = fma(q, far, splat(np.float32(2.832977059e00)))
    return where_less(splat(np.float32(17)), w, splat(np.float32(6)), q)
