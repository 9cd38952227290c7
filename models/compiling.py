"""Compilation of what runs over many directions: as wide vectors as the machine has."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from gonio.models.kept_jit import kept_jit

WIDE = {"xla_cpu_prefer_vector_width": 512, "xla_backend_optimization_level": 2}
"""XLA uses half of an AVX-512 processor's vectors unless it is told to; narrower processors take their own width. Level
3 makes of a selection that channels share a branch around the loop over them, which is then no vector code any more."""


@functools.cache
def options() -> dict:
    """`WIDE`, or nothing where this release of XLA refuses it: it is there for speed only."""
    try:
        jax.jit(lambda x: x, compiler_options=WIDE).lower(np.zeros(())).compile()
    except jax.errors.JaxRuntimeError:
        return {}
    return WIDE


def wide_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`kept_jit` for kernels over many directions; positional arguments only."""

    return kept_jit(function, options=options)
