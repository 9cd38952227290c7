"""Compiled programs are let go where they take too many memory mappings, and what they compute stays the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.compiled.program_memory import free_programs, mappings
from gonio.models.geometry.directions import Direction, dot
from gonio.models.kept_jit import kept_jit

SIZES = range(3, 43)


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path))
    # What JAX keeps itself of these is not written again by others.
    least = jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1e6)
    yield
    jax.config.update("jax_persistent_cache_min_compile_time_secs", least)


@pytest.mark.skipif(not mappings(), reason="this system does not list memory mappings")
def test_programs_are_let_go_and_made_again():
    product = kept_jit(dot)

    def every():
        both = [[Direction(*np.random.default_rng(k + n).normal(size=(3, n))) for k in (0, 99)] for n in SIZES]
        return [np.asarray(product(a, b) + jnp.arange(float(a.x.size))) for a, b in both]

    first = every()
    most = mappings()
    assert not free_programs(most + 1000) and free_programs(0)
    assert mappings() < most - len(SIZES)
    for a, b in zip(first, every(), strict=True):
        np.testing.assert_array_equal(a, b)
