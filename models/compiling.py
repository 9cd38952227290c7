"""Compilation by what a program is for: wide vectors over many directions, or soon at hand for a few numbers."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from gonio.models.kept_jit import kept_jit

WIDE = {"xla_cpu_prefer_vector_width": 512, "xla_backend_optimization_level": 2}
"""XLA uses half of an AVX-512 processor's vectors unless it is told to; narrower processors take their own width. Level
3 makes of a selection that channels share a branch around the loop over them, which is then no vector code any more."""


OLDER_LOOPS = {"xla_cpu_use_fusion_emitters": False}
"""XLA's earlier code for loops: large programs that run seldom are compiled in half the time."""


def _accepted(wanted: dict) -> dict:
    """Options, or nothing where this release of XLA refuses them: they are there for speed only."""
    try:
        jax.jit(lambda x: x, compiler_options=wanted).lower(np.zeros(())).compile()
    except jax.errors.JaxRuntimeError:
        return {}
    return wanted


@functools.cache
def options() -> dict:
    """`WIDE`, where it is accepted."""
    return _accepted(WIDE)


@functools.cache
def sparing_options() -> dict:
    """`OLDER_LOOPS`, where they are accepted."""
    return _accepted(OLDER_LOOPS)


def wide_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`kept_jit` for kernels over many directions; positional arguments only."""
    return kept_jit(function, options=options)


def sparing_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`kept_jit` for large programs of a few numbers, which take longer to compile than to run."""
    return kept_jit(function, options=sparing_options)
