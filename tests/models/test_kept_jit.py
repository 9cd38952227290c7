"""Programs kept on disk give what was traced would give, and are made again where anything that matters has changed."""

import dataclasses
import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.compiled import kept
from gonio.models.fingerprint import Unknown, fingerprint, surroundings
from gonio.models.geometry.directions import Direction, dot, from_spherical
from gonio.models.kept_jit import kept_jit
from gonio.models.microfacet.ggx import GGX

A, B = (Direction(*np.random.default_rng(k).normal(size=(3, 5))) for k in (1, 2))
TRACED = "/jax/core/compile/jaxpr_trace_duration"


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path))
    monkeypatch.delenv("GONIO_NO_CACHE", raising=False)
    # What JAX has kept of another test is not written again.
    least = jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1e6)
    yield
    jax.config.update("jax_persistent_cache_min_compile_time_secs", least)


@pytest.fixture
def traces():
    """What is traced, as it happens."""
    names = []

    def listen(event, duration, **details):
        if event == TRACED:
            names.append(details)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield names
    jax.monitoring.unregister_event_duration_listener(listen)


def _files():
    return sorted(os.listdir(os.environ["GONIO_PROGRAMS_DIR"]))


def test_a_kept_program_is_not_traced_again_and_gives_the_same_bits(traces):
    first = np.asarray(kept_jit(dot)(A, B))
    assert len(_files()) == 1
    traces.clear()
    again = np.asarray(kept_jit(dot)(A, B))
    assert not traces
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(again, sum(a * b for a, b in zip(A, B, strict=True)), rtol=1e-15)


def test_kinds_of_numbers_and_static_arguments_have_programs_of_their_own():
    narrow = Direction(*(c.astype(np.float32) for c in A))
    assert kept_jit(dot)(narrow, narrow).dtype == np.float32
    assert kept_jit(dot)(A, A).dtype == np.float64
    assert kept_jit(dot)(Direction(*(c[:2] for c in A)), Direction(1.0, 0.0, 2.0)).shape == (2,)
    assert kept_jit(dot)(Direction(*(c[:2] for c in A)), Direction(1.0, 0.0, 3.0)).shape == (2,)
    assert len(_files()) == 4


@pytest.mark.parametrize("damage", [b"", b"gonio", None])
def test_a_damaged_program_is_made_again(damage):
    expected = np.asarray(kept_jit(dot)(A, B))
    place = os.path.join(os.environ["GONIO_PROGRAMS_DIR"], _files()[0])
    with open(place, "rb") as file:
        data = file.read()
    with open(place, "wb") as file:
        file.write(data[:-7] + bytes(7) if damage is None else damage)
    np.testing.assert_array_equal(kept_jit(dot)(A, B), expected)


def test_programs_that_nothing_has_used_for_long_go():
    kept_jit(dot)(A, B)
    old, used = (os.path.join(os.environ["GONIO_PROGRAMS_DIR"], name) for name in ("old", _files()[0]))
    with open(old, "wb"):
        os.utime(old, (0, 0))
    os.utime(used, (0, 0))
    kept.searched.clear()  # as in another process
    kept_jit(dot)(A, B)  # reads it, and it stays
    kept_jit(dot)(A, A._replace(x=np.zeros(5, np.float32)))
    assert not os.path.exists(old)
    assert os.path.exists(used)


def test_linear_algebra_is_loaded_with_its_library():
    matrix = np.eye(3) * 4
    solve = kept_jit(jnp.linalg.cholesky)
    np.testing.assert_array_equal(solve(matrix), 2 * np.eye(3))
    np.testing.assert_array_equal(kept_jit(jnp.linalg.cholesky)(matrix), 2 * np.eye(3))


def test_a_traced_call_is_a_part_of_what_is_traced():
    f = kept_jit(dot)
    slope = jax.grad(lambda x: f(Direction(x, 2.0, 0.0), Direction(3.0, x, 0.0)))(1.0)
    assert slope == 5.0
    assert not _files()


def test_what_another_process_would_not_know_is_not_kept(monkeypatch):
    assert kept_jit(lambda a: a + 1)(np.ones(2)).tolist() == [2, 2]  # of a module whose files are not known
    monkeypatch.setenv("GONIO_NO_CACHE", "1")
    assert kept_jit(dot)(A, B).shape == (5,)
    assert not _files()

    @dataclasses.dataclass
    class Local:
        x: float = 1.0

    for thing in (object(), Local(), lambda: 0):
        with pytest.raises(Unknown):
            fingerprint(thing)


def test_names_tell_apart_what_would_be_traced_otherwise():
    wide, narrow = np.zeros(2), np.zeros(2, np.float32)
    things = [None, 1, 1.0, True, "1", (1,), [1], {"a": 1}, {"b": 1}, frozenset({1}), dot, from_spherical, wide, narrow]
    model = GGX(jnp.asarray(0.3), jnp.asarray(0.3))
    things += [Direction(1, 2, 3), (1, 2, 3), model, dataclasses.replace(model, alpha_x=jnp.asarray([0.3, 0.2]))]
    names = [fingerprint(t) for t in things]
    assert len(set(names)) == len(names)
    other = GGX(jnp.asarray(0.9), jnp.asarray(0.1))
    assert fingerprint(model) != fingerprint(other)
    traced, also = ({id(v) for v in jax.tree.leaves(m)} for m in (model, other))
    assert fingerprint(model, traced) == fingerprint(other, also)


def test_surroundings_are_those_of_this_environment(monkeypatch):
    before = surroundings()
    surroundings.cache_clear()
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", "") + " --xla_cpu_enable_fast_math=false")
    assert surroundings() != before
    surroundings.cache_clear()
