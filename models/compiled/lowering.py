"""JAX's operations on numbers as nodes of a graph."""

from collections.abc import Callable
from typing import Any

from gonio.models.compiled.elementary import hyperbolic
from gonio.models.compiled.elementary.functions import Elementary
from gonio.models.compiled.elementary.power import cube_root, power
from gonio.models.compiled.graph import COMPARISONS, DTYPES, FLOATS, Graph, Unsupported

PLAIN = ("add", "sub", "mul", "neg", "and", "or", "xor", *COMPARISONS)
ROOTED = ("sqrt", "abs", "floor")
FUNCTIONS = (
    "exp", "exp2", "expm1", "log", "log1p", "sin", "cos", "tan", "tanh", "atan", "atan2", "acos", "asin", "erf", "erfc",
    "lgamma",
)  # fmt: skip
HYPERBOLIC = {"sinh": hyperbolic.sinh, "cosh": hyperbolic.cosh, "asinh": hyperbolic.asinh}
WHOLE_RANGE = {"i32": 2.0**31 - 1, "i64": 2.0**63}


def operation(graph: Graph, name: str, parameters: Any, dtype: str) -> Callable[..., int]:
    """The function of nodes that an operation of JAX is, for results of one kind.

    Raises:
        Unsupported: it is not translated.
    """
    special = {
        "max": graph.maximum, "min": graph.minimum,
        "integer_pow": lambda x: integer_power(graph, x, parameters["y"]),
        "pow": lambda x, y: power(graph, x, converted(graph, y, dtype)),
        "cbrt": lambda x: cube_root(graph, x),
        "select_n": lambda *a: selected(graph, *a),
        "convert_element_type": lambda x: converted(graph, x, dtype),
        "reduce_precision": lambda x: same_precision(graph, x, parameters),
        "clamp": lambda low, x, high: graph.minimum(graph.maximum(low, x), high),
        "square": lambda x: graph.apply("mul", x, x),
        "bitcast_convert_type": lambda x: graph.bits(x, dtype),
        "add_any": lambda *a: graph.apply("add", *a),
        "rsqrt": lambda x: graph.apply("div", graph.constant(1, dtype), graph.apply("sqrt", x)),
        "not": lambda x: inverted(graph, x),
        "sign": lambda x: sign(graph, x),
        "round": lambda x: nearest(graph, x, parameters["rounding_method"]),
        "is_finite": lambda x: finite(graph, x),
    }  # fmt: skip
    if name in special:
        return special[name]
    if name in PLAIN or (name in (*ROOTED, "div") and dtype in FLOATS):
        return lambda *a: graph.apply(name, *a)
    if name in FUNCTIONS and dtype in FLOATS:
        return getattr(Elementary(graph, dtype), name)
    if name in HYPERBOLIC and dtype in FLOATS:
        return lambda x: HYPERBOLIC[name](Elementary(graph, dtype), x)
    if name == "ceil" and dtype in FLOATS:
        return lambda x: graph.apply("neg", graph.apply("floor", graph.apply("neg", x)))
    raise Unsupported(name)


def integer_power(graph: Graph, x: int, exponent: int) -> int:
    """x^n by squaring."""
    if graph.dtype(x) not in FLOATS:
        raise Unsupported("integer_pow of integers")
    result, square, rest = None, x, abs(exponent)
    while rest:
        if rest & 1:
            result = square if result is None else graph.apply("mul", result, square)
        rest >>= 1
        if rest:
            square = graph.apply("mul", square, square)
    one = graph.constant(1, graph.dtype(x))
    result = one if result is None else result
    return result if exponent >= 0 else graph.apply("div", one, result)


def selected(graph: Graph, which: int, *cases: int) -> int:
    """The case whose number is `which`, or the second of two where it is true."""
    if graph.dtype(which) == "i1":
        first, second = cases
        return graph.apply("select", which, second, first)
    result = cases[-1]
    for k in reversed(range(len(cases) - 1)):
        chosen = graph.apply("le", which, graph.constant(k, graph.dtype(which)))
        result = graph.apply("select", chosen, cases[k], result)
    return result


def converted(graph: Graph, x: int, dtype: str) -> int:
    """Another kind of number; a float that no integer holds is XLA's."""
    source = graph.dtype(x)
    if source in FLOATS and dtype in WHOLE_RANGE and not graph.known(x):
        limit = graph.constant(WHOLE_RANGE[dtype] if source == "f64" else WHOLE_RANGE[dtype] / 2, source)
        graph.require(graph.apply("lt", graph.apply("abs", x), limit))
    return graph.convert(x, dtype)


def same_precision(graph: Graph, x: int, parameters: Any) -> int:
    kept = {"f32": (8, 23), "f64": (11, 52)}.get(graph.dtype(x))
    if kept != (parameters["exponent_bits"], parameters["mantissa_bits"]):
        raise Unsupported("reduce_precision")
    return x


def inverted(graph: Graph, x: int) -> int:
    return graph.apply("xor", x, graph.constant(True if graph.dtype(x) == "i1" else -1, graph.dtype(x)))


def sign(graph: Graph, x: int) -> int:
    """1, -1, or x itself where it is zero or not a number."""
    dtype = graph.dtype(x)
    zero = graph.constant(0, dtype)
    below = graph.apply("select", graph.apply("lt", x, zero), graph.constant(-1, dtype), x)
    return graph.apply("select", graph.apply("gt", x, zero), graph.constant(1, dtype), below)


def nearest(graph: Graph, x: int, method: Any) -> int:
    if int(method) != 1:  # 0 rounds halves away from zero
        raise Unsupported("round of halves away from zero")
    return graph.apply("rint", x)


def finite(graph: Graph, x: int) -> int:
    dtype = graph.dtype(x)
    return graph.apply("lt", graph.apply("abs", x), graph.constant(DTYPES[dtype]("inf"), dtype))
