"""Traces of JAX evaluated by NumPy: the same formulas and derivatives, without XLA's compilation of each of them."""

import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from gonio.models.compiled import known

EQUATION = known.equation


def flushed(step: Any, values: Any) -> list[np.ndarray]:
    """The results of one equation; numbers too small for all their digits become 0, as in XLA's programs."""
    results = EQUATION(step, values)
    return [np.where(np.abs(r) < np.finfo(r.dtype).tiny, 0, r) if r.dtype.kind == "f" else r for r in results]


def as_for_users() -> bool:
    """Whether programs are compiled as users have them: see tests/conftest.py."""
    return not jax.config.read("jax_disable_most_optimizations")


def by_numpy(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of models and arrays, traced once for each kind of them and evaluated by NumPy.

    Where programs are compiled as users have them, it is XLA's.
    """
    traces: dict[Any, Any] = {}
    compiled = eqx.filter_jit(function)

    def evaluated(*arguments: Any) -> Any:
        if as_for_users():
            return compiled(*arguments)
        arrays, static = eqx.partition(arguments, eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        others, rest = jax.tree.flatten(static)
        kind = (tree, rest, *others, *((a.shape, str(a.dtype)) for a in leaves))
        if kind not in traces:

            def of_leaves(*leaves: Any) -> Any:
                return function(*eqx.combine(jax.tree.unflatten(tree, leaves), static))

            traces[kind] = jax.make_jaxpr(of_leaves, return_shape=True)(*leaves)
        trace, shape = traces[kind]
        with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
            warnings.simplefilter("ignore", np.exceptions.ComplexWarning)  # the real part of a slope is meant
            patch.setattr(known, "equation", flushed)
            results = known.program(trace, [np.asarray(a) for a in leaves])
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    return evaluated
