"""Hyperbolic functions and the inverse of the sine for vectors: at most 2.5 units in the last place off (4 in float32).

XLA evaluates sines and cosines of what is so large that half of its exponential overflows, or nearly.
"""

from gonio.models.compiled.elementary.functions import EXP_RANGE, MANTISSA, Elementary


def sinh(e: Elementary, x: int) -> int:
    """(m + m/(m + 1))/2 of m = e^|x| - 1, which loses nothing near 0."""
    m = e.expm1(_in_range(e, x))
    whole = e.add(m, e.number(1.0))
    return e.with_sign(e.mul(e.number(0.5), e.add(m, e.g.apply("div", m, whole))), x)


def cosh(e: Elementary, x: int) -> int:
    half = e.mul(e.number(0.5), e.exp(_in_range(e, x)))
    return e.add(half, e.g.apply("div", e.number(0.25), half))


def asinh(e: Elementary, x: int) -> int:
    """log1p(a + a²/(1 + √(a² + 1))) of a = |x|, and log 2a where a² + 1 is a²."""
    a, one = e.g.apply("abs", x), e.number(1.0)
    square = e.mul(a, a)
    root = e.g.apply("sqrt", e.add(square, one))
    usual = e.add(a, e.g.apply("div", square, e.add(root, one)))
    large = e.compare("gt", a, 2.0 ** (MANTISSA[e.dtype] + 2))
    return e.with_sign(e.log1p(e.select(large, e.add(a, a), usual)), x)


def _in_range(e: Elementary, x: int) -> int:
    a = e.g.apply("abs", x)
    beyond = e.compare("gt", a, EXP_RANGE[e.dtype][1] - 2.0)
    e.g.require(e.g.apply("xor", beyond, e.true))
    return a
