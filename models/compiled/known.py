"""What of a formula does not depend on directions: computed in NumPy, once for each set of parameters."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

from gonio.models.compiled.arrays import MOVES

INLINED = ("pjit", "jit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")
"""Calls of a part of the formula."""
WHOLE: dict[str, Callable[..., Any]] = {}
"""What runs as a program of its own, by the name of its calls."""
ELEMENTWISE: dict[str, Callable[..., Any]] = {
    "add": np.add, "add_any": np.add, "sub": np.subtract, "mul": np.multiply, "max": np.maximum, "min": np.minimum,
    "neg": np.negative, "abs": np.abs, "sqrt": np.sqrt, "exp": np.exp, "exp2": np.exp2, "expm1": np.expm1,
    "log": np.log, "log1p": np.log1p, "sin": np.sin, "cos": np.cos, "tan": np.tan, "tanh": np.tanh,
    "atan2": np.arctan2, "sinh": np.sinh, "cosh": np.cosh, "asinh": np.arcsinh, "floor": np.floor, "ceil": np.ceil,
    "sign": np.sign, "square": np.square, "is_finite": np.isfinite, "real": np.real, "imag": np.imag,
    "lt": np.less, "le": np.less_equal, "gt": np.greater, "ge": np.greater_equal, "eq": np.equal, "ne": np.not_equal,
    "and": np.bitwise_and, "or": np.bitwise_or, "xor": np.bitwise_xor, "not": np.invert,
}  # fmt: skip


def whole(function: Callable[..., Any], run: Callable[..., Any]) -> Callable[..., Any]:
    """`jax.jit` of a function of parameters: of a formula's steps, it is taken as one, and is not NumPy's.

    Args:
        function: of arrays, one a parameter; its results are arrays in a PyTree.
        run: the same for values; programs that are kept, say.
    """
    WHOLE[function.__name__] = run
    return jax.jit(function)


def is_whole(step: Any) -> bool:
    return step.params.get("name") in WHOLE and step.primitive.name in INLINED


def equation(step: Any, values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The results of one equation of a trace, as arrays of the kinds that it declares."""
    with np.errstate(all="ignore"):
        results = _results(step, values)
    kinds: list[Any] = [v.aval for v in step.outvars]
    return [np.asarray(r, a.dtype) for r, a in zip(results, kinds, strict=True)]


def _results(step: Any, values: Sequence[np.ndarray]) -> Sequence[Any]:
    name, parameters = step.primitive.name, step.params
    if is_whole(step):
        with jax.ensure_compile_time_eval():
            return [np.asarray(a) for a in jax.tree.leaves(WHOLE[step.params["name"]](*values))]
    if name in INLINED:
        return program(called(step), values)
    if name == "scan":
        return _scan(values, **parameters)
    if name in MOVES:
        return [MOVES[name](*values, **parameters)]
    if name == "iota":
        shape, along = parameters["shape"], parameters["dimension"]
        return [np.arange(shape[along]).reshape([-1 if k == along else 1 for k in range(len(shape))]) + np.zeros(shape)]
    floating = np.issubdtype(step.outvars[0].aval.dtype, np.inexact)
    if name in ELEMENTWISE:
        return [ELEMENTWISE[name](*values)]
    if name == "div" and floating:
        return [np.divide(*values)]
    if name == "integer_pow" and floating:
        power = values[0] ** abs(parameters["y"])
        return [power if parameters["y"] >= 0 else 1 / power]
    if name == "convert_element_type":
        return [values[0].astype(parameters["new_dtype"])]
    if name == "select_n" and values[0].dtype == bool:
        return [np.where(values[0], values[2], values[1])]
    if name == "pow" and floating:
        return [np.power(*values)]
    if name == "dot_general" and parameters["dimension_numbers"][1] == ((), ()):
        return [np.tensordot(*values, axes=parameters["dimension_numbers"][0])]
    if name == "reduce_sum":
        return [np.sum(values[0], axis=parameters["axes"])]
    with jax.ensure_compile_time_eval():
        results = step.primitive.bind(*(jax.numpy.asarray(v) for v in values), **parameters)
    return results if step.primitive.multiple_results else [results]


def called(step: Any) -> Any:
    """The part of the formula that an equation calls, closed."""
    names = ("jaxpr", "call_jaxpr", "fun_jaxpr")
    part = next(step.params[n] for n in names if n in step.params)
    return part if isinstance(part, core.ClosedJaxpr) else core.ClosedJaxpr(part, ())


def literal(atom: Any) -> np.ndarray:
    """A number that a trace holds."""
    return np.asarray(atom.val, atom.aval.dtype)


def program(closed: Any, values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The results of a trace."""
    jaxpr = closed.jaxpr
    known: dict[Any, Any] = dict(zip(jaxpr.invars, values, strict=True))
    known |= {v: np.asarray(c) for v, c in zip(jaxpr.constvars, closed.consts, strict=True)}

    def value(atom: Any) -> Any:
        return literal(atom) if isinstance(atom, core.Literal) else known[atom]

    for step in jaxpr.eqns:
        known.update(zip(step.outvars, equation(step, [value(a) for a in step.invars]), strict=True))
    return [value(a) for a in jaxpr.outvars]


def _scan(
    values: Sequence[np.ndarray], jaxpr: Any, length: int, num_consts: int, num_carry: int, reverse: bool, **_: Any
) -> list[np.ndarray]:
    constants, carry = values[:num_consts], list(values[num_consts : num_consts + num_carry])
    rows: list[list[np.ndarray]] = [[] for _ in range(len(jaxpr.jaxpr.outvars) - num_carry)]
    for k in reversed(range(length)) if reverse else range(length):
        results = program(jaxpr, [*constants, *carry, *(x[k] for x in values[num_consts + num_carry :])])
        carry = results[:num_carry]
        for row, r in zip(rows, results[num_carry:], strict=True):
            row.append(r)
    return [*carry, *(np.stack(row[::-1] if reverse else row) for row in rows)]
