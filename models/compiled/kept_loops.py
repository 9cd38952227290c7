"""Loops that another process takes up by the name of their formula: it neither traces the formula nor writes code."""

import pickle
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.models.compiled import kept
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.machine import Code, machine
from gonio.models.compiled.trace import Known, Preparation, Step


class Aval(NamedTuple):
    """Shape and kind of the numbers of a value."""

    shape: tuple[int, ...]
    dtype: Any


class Variable(NamedTuple):
    """A result of an equation."""

    aval: Aval


class Primitive(NamedTuple):
    """What an equation does."""

    name: str


class Equation(NamedTuple):
    """An equation of a trace that NumPy computes, without JAX's objects."""

    primitive: Primitive
    params: dict[str, Any]
    outvars: tuple[Variable, ...]


class Loop(NamedTuple):
    """What is left of a formula when its code is written: shape and kind of a value, and the name of the code."""

    preparation: Preparation
    channels: tuple[int, ...]
    kind: str
    code: str


def taken_up(name: str) -> tuple[Loop, Code] | None:
    """The loop that an earlier process wrote of the formula of this name, if any.

    Raises:
        Unsupported: it found that there is none.
    """
    data = kept.read(_key(name)) if name else None
    if data is None:
        return None
    if not data:
        raise Unsupported("as in an earlier process")
    try:
        loop: Loop = pickle.loads(data)
    except Exception:  # of another release, or damaged: it is made again
        return None
    binary = kept.read(loop.code)
    return None if binary is None else (loop, Code(binary))


def keep(name: str, loop: Loop | None, leaves: Sequence[np.ndarray]) -> None:
    """Keep a loop, or that there is none, for the formula of this name; nothing of what needs JAX's own steps."""
    if not name:
        return
    if loop is None:
        kept.write(_key(name), b"")
        return
    try:
        preparation = _portable(loop.preparation)
        data = pickle.dumps(loop._replace(preparation=preparation))
        same = np.array_equal(preparation.parameters(leaves), loop.preparation.parameters(leaves), equal_nan=True)
    except (AttributeError, TypeError, pickle.PicklingError):
        return
    if same:
        kept.write(_key(name), data)


def _portable(preparation: Preparation) -> Preparation:
    steps = tuple(
        Step(_portable_equation(s.equation), tuple(map(_portable_operand, s.operands)), s.results)
        for s in preparation.steps
    )
    return Preparation(steps, tuple((_portable_operand(k), e) for k, e in preparation.slots))


def _portable_operand(operand: Any) -> Any:
    return operand._replace(aval=None) if isinstance(operand, Known) else operand


def _portable_equation(equation: Any) -> Equation:
    outvars = tuple(Variable(Aval(tuple(v.aval.shape), np.dtype(v.aval.dtype))) for v in equation.outvars)
    return Equation(Primitive(equation.primitive.name), dict(equation.params), outvars)


def _key(name: str) -> str:
    made = machine()
    return kept.key("loop", made.name if made else "", name)
