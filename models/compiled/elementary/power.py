"""x^y for vectors: the logarithm in two numbers, for it is multiplied by y before it comes back."""

import math

from gonio.models.compiled.elementary.coefficients import SPLIT
from gonio.models.compiled.elementary.functions import Elementary
from gonio.models.compiled.graph import Graph


def power(graph: Graph, x: int, y: int) -> int:
    """x^y, with the limits of IEEE 754 for x >= 0 and for whole y."""
    if graph.dtype(x) == "f32":
        wide = Elementary(graph, "f64")
        a, b = graph.convert(x, "f64"), graph.convert(y, "f64")
        magnitude = graph.apply("abs", a)
        value = wide.exp(graph.apply("mul_exact", b, wide.log(magnitude)))
        return graph.convert(_with_limits(wide, a, b, magnitude, value), "f32")
    e = Elementary(graph, "f64")
    magnitude = graph.apply("abs", x)
    high, low = _log_in_two(e, magnitude)
    product = e.mul(y, high)
    rest = e.fma(y, low, e.fma(y, high, graph.apply("neg", product)))
    finite = e.compare("lt", graph.apply("abs", product), 1e300)
    value = e.exp(product, e.select(finite, rest, e.number(0.0)))
    return _with_limits(e, x, y, magnitude, value)


def cube_root(graph: Graph, x: int) -> int:
    """∛x: by the logarithm, and one step of Newton's method."""
    if graph.dtype(x) == "f32":
        return graph.convert(cube_root(graph, graph.convert(x, "f64")), "f32")
    e, apply = Elementary(graph, "f64"), graph.apply
    magnitude = apply("abs", x)
    root = e.exp(e.mul(e.log(magnitude), e.number(1 / 3)))
    error = e.sub(root, apply("div", magnitude, e.mul(root, root)))
    root = e.with_sign(e.sub(root, e.mul(error, e.number(1 / 3))), x)
    ordinary = apply("and", apply("ge", magnitude, e.number(2.0**-1022)), e.compare("lt", magnitude, math.inf))
    return e.select(ordinary, root, x)


def _log_in_two(e: Elementary, x: int) -> tuple[int, int]:
    """log x as a sum of two numbers, to 1e-19 of it, of a normal number."""
    g, one, two = e.g, e.number(1.0), e.number(2.0)
    m, n = e.split(x)
    f, den = e.sub(m, one), e.add(m, one)
    s = g.apply("div", f, den)
    minus = g.apply("neg", s)
    s_low = g.apply("div", e.fma(minus, e.sub(m, e.sub(den, one)), e.fma(minus, den, f)), den)
    z = e.mul(s, s)
    z_low = e.fma(e.mul(two, s), s_low, e.fma(s, s, g.apply("neg", z)))
    third, third_low = (e.number(v) for v in SPLIT["2/3", "f64"])
    tail = e.mul(z, e.polynomial(z, "pow"))
    u = e.add(third, tail)
    u_low = e.add(e.sub(tail, e.sub(u, third)), third_low)
    v = e.mul(z, u)
    v_low = e.fma(z_low, u, e.fma(z, u_low, e.fma(z, u, g.apply("neg", v))))
    r = e.add(two, v)
    r_low = e.add(e.sub(v, e.sub(r, two)), v_low)
    log = e.mul(s, r)
    log_low = e.fma(s_low, r, e.fma(s, r_low, e.fma(s, r, g.apply("neg", log))))
    ln2, ln2_low = (e.number(v) for v in SPLIT["log 2", "f64"])
    whole = e.mul(n, ln2)  # exact: ln2 has 42 bits
    high = e.add(whole, log)
    return high, e.fma(n, ln2_low, e.add(e.sub(log, e.sub(high, whole)), log_low))


def _with_limits(e: Elementary, x: int, y: int, magnitude: int, value: int) -> int:
    """The value where x is a positive normal number; else what IEEE 754 says."""
    g, zero, one, infinity = e.g, e.number(0.0), e.number(1.0), e.number(math.inf)
    grows = e.compare("gt", y, 0.0)
    tiny = e.compare("lt", magnitude, 2.0**-1022)
    value = e.select(tiny, e.select(grows, zero, infinity), value)
    value = e.select(e.compare("eq", magnitude, math.inf), e.select(grows, infinity, zero), value)
    half = e.mul(y, e.number(0.5))
    whole = g.apply("eq", g.apply("floor", y), y)
    even = g.apply("eq", g.apply("floor", half), half)
    signed = e.select(even, value, g.apply("neg", value))
    negative = e.compare("lt", x, 0.0)
    whole = g.apply("or", whole, tiny)
    value = e.select(negative, e.select(whole, signed, e.number(math.nan)), value)
    value = e.select(g.apply("ne", x, x), x, value)
    value = e.select(g.apply("ne", y, y), y, value)
    trivial = g.apply("or", e.compare("eq", y, 0.0), e.compare("eq", x, 1.0))
    return e.select(trivial, one, value)
