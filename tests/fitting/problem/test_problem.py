"""Streamed sums against the whole Jacobian by differentiation of the whole model, in one page and in several."""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.fitting.problem.compiled_sums import compile_sums
from gonio.fitting.problem.deferred_arrays import DeferredValues
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import PAGE, Readings, block_of, coarse_cells, in_blocks, transform
from gonio.models.compiled import known
from gonio.models.expression.builder import assemble, parse, together
from gonio.models.expression.parser import with_defaults
from gonio.models.geometry.directions import Direction
from support.marks import thorough


def readings(n, channels, seed=0):
    rng = np.random.default_rng(seed)
    w = []
    for _ in range(2):
        theta, phi = rng.uniform(0, 1.4, n), rng.uniform(0, 2 * np.pi, n)
        w.append(Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)))
    f = rng.uniform(0.01, 1, (n, channels))
    return Readings(*w, f, np.full(f.shape, np.nan), rng.random(f.shape) > 0.1)


# Free in each channel and shared, listed shapes, a held number inside; more than one page in the last.
CASES = [
    ("lambert + ggx(f0=?)", 3, 700),
    ("lambert + ggx(alpha~[0.2,0.3], f0=0.04)", 2, 300),
    ("lambert(rho=0.2) + phong", 1, PAGE * block_of(1) + 5),
    ("beckmann(f0=[0.1, 0.2])", 2, 90),
    ("eon + sgd", 1, 90),
    ("charlie + gtr", 1, 90),
]


def problem_of(model, part, weight):
    s, fixed, _ = parameters(with_defaults(parse(model)), part.f.shape[1])
    return FitProblem.create(s, fixed, "cbrt", part, weight, 0.01)


@pytest.mark.parametrize(
    ("model", "channels", "n", "by"),
    [
        (*CASES[0], "compiled loop"),
        (*CASES[4], "compiled loop"),
        (*CASES[2], "xla"),
        *thorough(*((*CASES[k], "compiled loop") for k in (1, 2, 3, 5))),
    ],
)
def test_sums_are_those_of_the_whole_jacobian(monkeypatch, model, channels, n, by):
    monkeypatch.setenv("GONIO_EVALUATE_WITH", by)
    part = readings(n, channels)
    weight = np.where(part.valid, 0.5 + np.random.default_rng(2).random(part.f.shape), 0.0)
    problem = problem_of(model, part, weight)
    s = problem.parameters
    p = np.random.default_rng(1).uniform(0.2, 0.6, s.size)

    def residual(p):
        terms = []
        for t, of in enumerate(s.frames):
            free = {g.path: p[s.of(g)] if g.per_channel else p[g.first] for g in s.free if g.term == t}
            terms.append(assemble(of, {**problem.fixed[t], **free}))
        f = jax.vmap(together(terms).f)(*(Direction(*(jnp.asarray(c) for c in w)) for w in (part.wi, part.wo)))
        f = jnp.broadcast_to(f.reshape(n, -1), (n, channels)) * part.wi.z[:, None]
        target = transform("cbrt", part.f * part.wi.z[:, None], 0.01, np)[0]
        return (weight * (transform("cbrt", f, 0.01)[0] - target)).ravel()

    r, jac = known.program(jax.make_jaxpr(lambda p: (residual(p), jax.jacfwd(residual)(p)))(p), [p])
    total = problem.normal_equations(np.stack([p, p * 1.1]), np.array([True, False]))
    np.testing.assert_allclose(total.cost, [0.5 * r @ r, 0.0], rtol=1e-12)
    jac = jac[:, problem.order]
    np.testing.assert_allclose(total.gradient[0], jac.T @ r, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(total.matrix.whole()[0], jac.T @ jac, rtol=1e-10, atol=1e-12)
    at = problem.evaluate(p)
    assert at.scores is not None
    np.testing.assert_allclose(at.scores.whole(), (jac * r[:, None] ** 2).T @ jac, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(problem.residuals(at.f).ravel(), r, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        problem.target_norm_squared, np.sum((weight * problem.compared(part.f)) ** 2), rtol=1e-12
    )


def test_what_loops_cannot_compute_is_left_to_xla():
    for model, taken in {"ggx": True, "rayleigh_rice": False, "he_torrance": False}.items():
        s, fixed, _ = parameters(with_defaults(parse(model)), 1)
        assert compile_sums(s, "cbrt", fixed) == taken


def test_a_changed_problem_is_the_one_made_so():
    """Subset, weights and targets: the same sums as of a problem that was created with them."""
    part = readings(700, 2)
    weight = np.where(part.valid, 1.0, 0.0)
    problem = problem_of("lambert + ggx(f0=?)", part, weight)
    p = np.random.default_rng(1).uniform(0.2, 0.6, (1, problem.parameters.size))
    cells = np.arange(0, 700, 3)
    other = weight * np.random.default_rng(3).random(weight.shape)
    pairs = [
        (problem.subset(cells), problem_of("lambert + ggx(f0=?)", part.part(cells), weight[cells])),
        (problem.reweighted(other), problem_of("lambert + ggx(f0=?)", part, other)),
        (problem.retargeted(problem.compared(part.f)), problem),
    ]
    for changed, created in pairs:
        assert changed.target_norm_squared == pytest.approx(created.target_norm_squared, rel=1e-12)
        for a, b in zip(*(jax.tree.leaves(q.normal_equations(p)) for q in (changed, created)), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-12)


def test_coarse_cells_see_what_is_rare():
    """Of 100,000 cells 20 lie near the mirror direction: all are among the first thousand; the rest is even."""
    part = readings(100_000, 1)
    wi, wo = (Direction(*(c.copy() for c in w)) for w in (part.wi, part.wo))
    for k in range(20):
        wo.x[k], wo.y[k], wo.z[k] = -wi.x[k], -wi.y[k], wi.z[k]
    part = Readings(wi, wo, part.f, part.u_f, part.valid)
    cells = coarse_cells(part, 1000, 0)
    assert cells.size == 1000 == np.unique(cells).size and set(range(20)) <= set(cells.tolist())
    np.testing.assert_array_equal(cells, coarse_cells(part, 1000, 0))
    assert 0.4 < np.mean(cells > 50_000) < 0.6


def test_values_are_laid_out_in_padded_blocks():
    laid = in_blocks(np.arange(1000.0), (PAGE, 64), 1.0).reshape(-1)
    np.testing.assert_array_equal(laid, np.append(np.arange(1000.0), np.ones(PAGE * 64 - 1000)))
    again = in_blocks(laid[:1000], (PAGE, 64)).reshape(-1)  # laid out already: taken as it stands
    np.testing.assert_array_equal(again[:1000], np.arange(1000.0))


def test_values_of_a_large_table_are_computed_where_they_are_asked_for(monkeypatch):
    """The sums are the same, piece by piece, and so is every value, however it is taken out."""
    part = readings(700, 2)
    problem = problem_of("lambert + ggx(alpha~[0.2,0.3], f0=0.04)", part, np.where(part.valid, 1.0, 0.0))
    p = np.linspace(0.2, 0.6, problem.parameters.size)
    whole = problem.evaluate(p)
    monkeypatch.setattr("gonio.fitting.problem.problem.MANY", 100)
    monkeypatch.setattr("gonio.fitting.problem.compiled_sums.SCRATCH", 256)
    pieces = problem.evaluate(p)
    if not isinstance(pieces.f, DeferredValues):
        pytest.skip("no compiled loops on this processor")
    sums = ((e.equations.cost, e.equations.gradient, *e.equations.matrix, *e.scores) for e in (whole, pieces))
    for a, b in zip(*sums, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    few = np.array([3, 1, 600])
    for key in (slice(5, 90), few, np.ix_(few, [1]), (slice(None), 1), part.valid, part.valid[:, 0], 7):
        assert np.array_equal(pieces.f[key], whole.f[key])
    assert np.array_equal(pieces.f.take(few, axis=0), whole.f[few]) and np.array_equal(pieces.f + 1, whole.f + 1)
    assert np.array_equal(pickle.loads(pickle.dumps(pieces.f)), whole.f)
