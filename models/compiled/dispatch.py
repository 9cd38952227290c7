"""Which program evaluates a model: made once for each kind of model, with its parameters once for each model."""

import os
import threading
import weakref
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import Tracer

from gonio.models.compiled import kept
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.program import Bound, Program
from gonio.models.fingerprint import program_name

LARGEST_LEAF = 1 << 12
"""Numbers of one array of a model; what has more is a table to be looked up, and not a formula."""
KEPT = 256
"""Programs, and models with their parameters, that a process remembers."""
LOCK = threading.RLock()
_config: Any = jax.config


class Formula(NamedTuple):
    """What is evaluated: `value(model, *components)` of scalars, and for each component the axes that its array has.

    The function is known by its identity: it is the same object for the same formula.
    """

    value: Callable[..., Any]
    axes: tuple[tuple[int, ...], ...]


class _Remembered(NamedTuple):
    model: weakref.ref
    bound: Bound | None


_programs: dict[Hashable, Program | None] = {}
_models: dict[Hashable, _Remembered] = {}


def usable() -> bool:
    """Whether loops in double precision may be used: on a processor, in that precision, and nobody asks for XLA."""
    forbidden = os.environ.get("GONIO_EVALUATE_WITH") == "xla"
    return not forbidden and jax.default_backend() == "cpu" and jax.dtypes.canonicalize_dtype(float) == np.float64


def values(
    formula: Formula, model: Any, arrays: Sequence[np.ndarray], sizes: tuple[int, ...], dtype: Any
) -> np.ndarray | None:
    """The formula's values, shape (*sizes, *channels), or None where XLA has to compute them.

    Args:
        formula: what to evaluate.
        model: a PyTree of parameters.
        arrays: the components, each of the sizes of its axes.
        sizes: of the loops, outermost first.
        dtype: the kind of number that components are taken for.
    """
    key = (formula.value, formula.axes, id(model), dtype)
    remembered = _models.get(key)
    if remembered is None or remembered.model() is not model:
        bound, lasting = _bound(formula, model, dtype)
        if lasting:
            _remember(_models, key, _Remembered(weakref.ref(model), bound))
    else:
        bound = remembered.bound
    return None if bound is None else bound(arrays, sizes)


def _bound(formula: Formula, model: Any, dtype: Any) -> tuple[Bound | None, bool]:
    """The program with the model's parameters, and whether they cannot change."""
    leaves, tree = jax.tree.flatten(model)
    arrays = [v for v in leaves if isinstance(v, jax.Array | np.ndarray | np.generic)]
    if any(isinstance(v, Tracer) for v in arrays) or jax.default_backend() != "cpu":
        return None, False
    if any(v.size > LARGEST_LEAF for v in arrays) or os.environ.get("GONIO_EVALUATE_WITH") == "xla":
        return None, True
    lasting = not any(isinstance(v, np.ndarray) and v.flags.writeable for v in arrays)
    kinds = tuple((v.shape, str(v.dtype)) if isinstance(v, jax.Array | np.ndarray | np.generic) else v for v in leaves)
    try:
        key = (formula.value, formula.axes, dtype, tree, kinds)
        known = key in _programs
    except TypeError:  # a model with something in it that has no hash
        return None, True
    program = _programs[key] if known else _program(key, formula, leaves, tree, dtype)
    return (None if program is None else program.bound(arrays)), lasting


def _program(key: Hashable, formula: Formula, leaves: list[Any], tree: Any, dtype: Any) -> Program | None:
    places = [k for k, v in enumerate(leaves) if isinstance(v, jax.Array | np.ndarray | np.generic)]

    def value(arrays: Sequence[Any], *components: Any) -> Any:
        filled = list(leaves)
        for k, v in zip(places, arrays, strict=True):
            filled[k] = v
        return formula.value(jax.tree.unflatten(tree, filled), *components)

    with LOCK:
        if key not in _programs:
            try:
                arrays = [leaves[k] for k in places]
                program = Program(value, arrays, formula.axes, dtype, _name(formula, tree, leaves, dtype))
            except Unsupported:
                program = None
            _remember(_programs, key, program)
        return _programs[key]


def _name(formula: Formula, tree: Any, leaves: list[Any], dtype: Any) -> str:
    """What another process knows the program by; empty where none would, or is to."""
    if not kept.keeping():
        return ""
    arrays = {id(v) for v in leaves if isinstance(v, jax.Array | np.ndarray | np.generic)}
    of = (formula.value, formula.axes, str(np.dtype(dtype)), bool(_config.jax_enable_x64))
    return program_name("loop", *of, jax.tree.unflatten(tree, leaves), traced=arrays)


def _remember(table: dict, key: Hashable, value: Any) -> None:
    """Add an entry; the oldest goes."""
    with LOCK:
        while len(table) >= KEPT:
            table.pop(next(iter(table)), None)
        table[key] = value
