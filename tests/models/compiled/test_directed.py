"""Compiled loops over directions against JAX's trace in NumPy: every model, every shape, what falls back."""

import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.tabulate import grid_values
from gonio.models.catalog import MODELS
from gonio.models.compiled import kept, known
from gonio.models.compiled.directed import directed_values
from gonio.models.diffuse.lambert import Lambert
from gonio.models.evaluation import evaluate, evaluate_in_blocks
from gonio.models.expression.builder import build, example
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.stability.precision import cast

BY_XLA = {
    "rayleigh_rice": "complex numbers",
    "he_torrance": "a series of more operations than are written one by one",
}
"""Examples of the catalogue that XLA evaluates."""
GOLD = "ggx(alpha=0.2, eta=[0.2, 0.4, 1.4], k=[3.4, 2.3, 1.8])"


def pairs(count, seed=0):
    """Anywhere above the horizon and a little below, near it, near the mirror and the light's own direction."""
    rng = np.random.default_rng(seed)
    theta, phi = np.arccos(rng.uniform(-0.1, 1, (2, count))), rng.uniform(0, 2 * np.pi, (2, count))
    q = count // 5
    theta[:, :q] = np.pi / 2 - 10.0 ** rng.uniform(-9, -1, (2, q))
    theta[1, q : 3 * q] = theta[0, q : 3 * q]
    phi[1, q : 2 * q] = phi[0, q : 2 * q] + np.pi + rng.normal(size=q) * 1e-4
    phi[1, 2 * q : 3 * q] = phi[0, 2 * q : 3 * q]
    theta[:, -3:] = [[0, 0, 0.4], [0, 0.4, 0]]
    return [np.asarray(c) for t, p in zip(theta, phi, strict=True) for c in from_spherical(t, p)]


def reference(model, arrays):
    """The model's trace over all pairs, evaluated by NumPy."""
    leaves, static = eqx.partition(model, eqx.is_array)

    def f(leaves, *c):
        brdf = eqx.combine(leaves, static)
        return jax.vmap(lambda *d: brdf.f(Direction(*d[:3]), Direction(*d[3:])))(*c)

    trace = jax.make_jaxpr(f)(leaves, *arrays)
    return known.program(trace, [*(np.asarray(v) for v in jax.tree.leaves(leaves)), *arrays])[0]


def require_close(values, true, digits):
    np.testing.assert_allclose(values, true, rtol=digits, atol=digits * 1e-3)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_is_what_jax_traces(name):
    model, arrays = build(example(name).strip("'")), pairs(300)
    values = directed_values(model, arrays, (300,))
    assert (values is None) == (name in BY_XLA)
    digits = 1e-12
    if values is None:
        values, digits = np.asarray(evaluate(model, Direction(*arrays[:3]), Direction(*arrays[3:]))), 1e-11
    require_close(values, reference(model, arrays), digits)
    assert values.dtype == np.float64 and np.isfinite(values).all()


@pytest.mark.parametrize("energy", ["kulla_conty", "turquin"])
def test_compensated_lobes_are_what_jax_traces(energy):
    model, arrays = build(f"ggx(alpha=0.4, eta=0.2, k=[3.9, 2.5], energy={energy})"), pairs(300)
    require_close(directed_values(model, arrays, (300,)), reference(model, arrays), 1e-12)


def test_padded_arrays_are_those_of_jax():
    """Ends added and cut, and zeros in between."""

    class Padded(Lambert):
        def formula(self, wi, wo):
            both = jnp.stack([wi.z, wo.z, wi.x])
            return jnp.concatenate([jax.lax.pad(both, wo.x, [c]) for c in ((1, 2, 0), (-1, 3, 2), (0, -2, 1))])

    model, arrays = Padded(rho=jnp.array(0.5)), pairs(40)
    require_close(directed_values(model, arrays, (40,)), reference(model, arrays), 1e-15)


@pytest.mark.parametrize("expression", ["lambert(rho=0.5) + 1 * ggx(alpha=0.2, f0=0.04)", GOLD, "eon(rho=0.5, r=0.5)"])
def test_single_precision_is_computed_in_single_precision(expression):
    arrays, model = [a.astype(np.float32) for a in pairs(300)], cast(build(expression), np.float32)
    with jax.enable_x64(False):
        values = directed_values(model, arrays, (300,))
        assert values is not None
        require_close(values, reference(model, arrays), 2e-5)
        assert values.dtype == np.float32


@pytest.mark.parametrize(
    ("of_wi", "of_wo"),
    [((), ()), ((7,), ()), ((0,), (0,)), ((3, 1), (40,)), ((40,), (3, 1)), ((300, 1), (1, 200)), ((1, 200), (300, 1)),
     ((), (70_000,)), ((70_000,), (1,)), ((9000, 1, 1), (2, 3)), ((2, 40_000), (40_000,))],
)  # fmt: skip
def test_any_shape_is_that_of_its_pairs(of_wi, of_wo):
    rng = np.random.default_rng(5)
    wi, wo = (from_spherical(np.arccos(rng.uniform(0, 1, s)), rng.uniform(0, 6, s)) for s in (of_wi, of_wo))
    arrays = [np.asarray(c) for c in (*wi, *wo)]
    flat = [np.ascontiguousarray(a).reshape(-1) for a in np.broadcast_arrays(*arrays)]
    model = build(GOLD)
    values, shape = evaluate(model, wi, wo), np.broadcast_shapes(of_wi, of_wo)
    assert values.shape == (*shape, 3)
    pair_by_pair = evaluate(model, Direction(*flat[:3]), Direction(*flat[3:]))
    np.testing.assert_allclose(np.asarray(values).reshape(-1, 3), pair_by_pair, rtol=1e-13)
    assert evaluate_in_blocks(model, wi, wo).shape == (flat[0].size, 3)


def test_a_grid_of_axes_is_its_cells():
    layout = layouts.merl()
    model = build("lambert(rho=0.5) + 1 * ggx(alpha=0.2, f0=0.04)")
    rows = grid_values(model, layout, 40, 42)
    cells = np.arange(40, 42)[:, None] * 90 * 180 + np.arange(90 * 180)
    wi, wo = layout.directions_at(cells.reshape(-1))
    np.testing.assert_allclose(rows.reshape(-1), evaluate(model, wi, wo), rtol=1e-11, atol=1e-15)


def test_arrays_of_any_kind_are_read_as_they_are():
    """Strided views, integers and single precision need no care of the caller."""
    table = np.random.default_rng(2).normal(size=(50_000, 6))
    table[:, [2, 5]] = abs(table[:, [2, 5]])
    model = build("eon(rho=0.5, r=0.5)")
    whole = [np.ascontiguousarray(c) for c in table.T]
    true = evaluate(model, Direction(*whole[:3]), Direction(*whole[3:]))
    np.testing.assert_array_equal(evaluate(model, Direction(*table.T[:3]), Direction(*table.T[3:])), true)
    single = [c.astype(np.float32) for c in whole]
    read = evaluate(model, Direction(*single[:3]), Direction(*single[3:]))
    assert read.dtype == np.float64
    np.testing.assert_allclose(read, true, rtol=1e-3, atol=1e-6)
    assert evaluate(model, Direction(0, 0, 1), Direction(0, 0, 1)) == pytest.approx(0.5 / np.pi, rel=0.1)


def test_numpy_gives_numpy_and_jax_gives_jax():
    model, w = build("lambert(rho=0.5)"), from_spherical(np.array([0.1, 0.2]), 0.0)
    assert isinstance(evaluate(model, Direction(*map(np.asarray, w)), Direction(*map(np.asarray, w))), np.ndarray)
    assert isinstance(evaluate(model, Direction(*map(jnp.asarray, w)), w), jax.Array)


def test_parameters_are_those_of_the_call():
    """Neither an array that changes in place nor a model at the address of one that is gone is taken for another."""
    up, rho = Direction(np.zeros(3), np.zeros(3), np.ones(3)), np.array([0.1, 0.2])
    model = Lambert(rho=rho)
    for scale in (1.0, 2.0):
        np.testing.assert_allclose(evaluate(model, up, up)[0], scale * np.array([0.1, 0.2]) / np.pi)
        rho *= 2
    for k in range(200):
        assert evaluate(Lambert(rho=jnp.array(k / 200)), up, up)[0] == pytest.approx(k / 200 / np.pi)


def test_traced_parameters_are_xlas():
    up = Direction(np.zeros(3), np.zeros(3), np.ones(3))
    slope = jax.jit(jax.grad(lambda rho: jnp.sum(evaluate(Lambert(rho=rho), up, up))))(0.3)
    assert slope == pytest.approx(3 / np.pi)


def test_a_users_own_operation_falls_back():
    """A sort is not translated."""

    class Sorted(Lambert):
        def formula(self, wi, wo):
            return jnp.sort(jnp.stack([wi.z, wo.z]))[0] * self.rho

    w = [np.asarray(c) for c in from_spherical(np.array([0.3, 0.4]), 0.0)]
    model = Sorted(rho=jnp.array(0.5))
    assert directed_values(model, [*w, *w], (2,)) is None
    np.testing.assert_allclose(evaluate(model, Direction(*w), Direction(*w)), 0.5 * w[2])


def test_a_kept_program_that_was_changed_is_made_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path / "kept"))
    name = kept.key("a", "program")
    assert kept.read(name) is None
    kept.write(name, b"machine code")
    assert kept.read(name) == b"machine code"
    file = tmp_path / "kept" / name
    file.chmod(0o666)  # anybody may have written it
    assert kept.read(name) is None
    file.chmod(0o600)
    for damaged in (file.read_bytes()[:-1], b"", file.read_bytes().replace(b"code", b"evil")):
        file.write_bytes(damaged)
        assert kept.read(name) is None
    (tmp_path / "file").touch()
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path / "file"))
    kept.write(name, b"machine code")  # a folder that is none: nothing is kept, nothing is raised
    monkeypatch.setenv("GONIO_NO_CACHE", "1")
    assert kept.folder() is None


def test_a_second_process_loads_what_the_first_compiled(tmp_path):
    code = """
import numpy as np
from gonio.models import Direction, build, evaluate
from gonio.models.compiled import machine
made, compiled = [], machine._compiled
machine._compiled = lambda *a: made.append(1) or compiled(*a)
w = Direction(np.zeros(9), np.zeros(9), np.ones(9))
print(float(evaluate(build("minnaert(rho=0.5, k=1.3)"), w, w)[0]).hex(), len(made))
"""
    env = os.environ | {"GONIO_PROGRAMS_DIR": str(tmp_path)}
    first, second = (
        subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout.split()
        for _ in range(2)
    )
    assert (first[1], second[1]) == ("1", "0")
    assert first[0] == second[0]
