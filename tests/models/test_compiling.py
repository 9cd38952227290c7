"""Compilation with an option of XLA's that a release may not know."""

import jax.numpy as jnp

from gonio.models import compiling


def test_without_the_option_compilation_goes_on(monkeypatch):
    monkeypatch.setattr(compiling, "WIDE", {"xla_no_such_option": 512})
    monkeypatch.setattr(compiling, "options", compiling.options.__wrapped__)
    assert compiling.options() == {}
    assert float(compiling.wide_jit(lambda x: x + 1)(jnp.asarray(1.0))) == 2


def test_the_option_is_known_here():
    assert compiling.options() == compiling.WIDE
