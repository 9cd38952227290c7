"""Streamed sums against the whole Jacobian by differentiation of the whole model, in one page and in several."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.fitting.problem.blocks import PAGE, block_of
from gonio.fitting.problem.domains import to_unconstrained
from gonio.fitting.problem.losses import transform
from gonio.fitting.problem.normal_equations import closing, sums
from gonio.fitting.problem.parameterisation import domains_of, structure_of, with_defaults
from gonio.fitting.problem.readings import Readings, blocked, coarse_cells, in_blocks
from gonio.fitting.solver import levenberg_marquardt as solver
from gonio.fitting.solver.levenberg_marquardt import Problem, minimise
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build, parse
from gonio.models.geometry.directions import Direction


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
]


@pytest.mark.parametrize(("model", "channels", "n"), CASES)
def test_sums_are_those_of_the_whole_jacobian(model, channels, n):
    part, loss = readings(n, channels), "cbrt"
    s, fixed, _ = structure_of(with_defaults(parse(model)), channels)
    p = np.random.default_rng(1).uniform(0.2, 0.6, s.size)
    weight = np.where(part.valid, 0.5 + np.random.default_rng(2).random(part.f.shape), 0.0)
    data, _ = blocked(part, loss, weight, 0.01)
    names = {(g.term, g.name): slice(g.first, g.first + (channels if g.per_channel else 1)) for g in s.groups}

    def residual(p):
        from gonio.models.expression.builder import assemble, together

        terms = []
        for t, of in enumerate(s.frames):
            free = {
                name: p[at] if at.stop - at.start > 1 else p[at][0] for (term, name), at in names.items() if term == t
            }
            terms.append(assemble(of, {**fixed[t], **free}))
        f = jax.vmap(together(terms).f)(*(Direction(*(jnp.asarray(c) for c in w)) for w in (part.wi, part.wo)))
        f = jnp.broadcast_to(f.reshape(n, -1), (n, channels)) * part.wi.z[:, None]
        target = transform(loss, part.f * part.wi.z[:, None], 0.01, np)[0]
        return (weight * (transform(loss, f, 0.01)[0] - target)).ravel()

    r, jac = jax.jit(lambda p: (residual(p), jax.jacfwd(residual)(p)))(jnp.asarray(p))
    r, jac = np.asarray(r), np.asarray(jac)
    total, scatter = sums(s, loss, np.stack([p, p * 1.1]), fixed, data, np.array([True, False]), scattered=True)
    np.testing.assert_allclose(total.cost, [0.5 * r @ r, 0.0], rtol=1e-12)
    np.testing.assert_allclose(total.gradient[0], jac.T @ r, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(total.matrix[0], jac.T @ jac, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(scatter[0], (jac * r[:, None] ** 2).T @ jac, rtol=1e-9, atol=1e-12)
    assert closing(s, loss, p, fixed, data).f.shape == (data.weight.shape[0] * data.weight.shape[1], channels)


def test_a_value_that_is_no_number_is_a_refused_step(monkeypatch):
    """A model that breaks down beyond some width: the descent turns back and arrives."""
    part = readings(400, 1)
    truth = build("lambert(rho=0.2) + 0.5*phong(n=20)")
    f = np.asarray(evaluate(truth, part.wi, part.wo)).reshape(-1, 1)
    part = Readings(part.wi, part.wo, f, part.u_f, np.ones(f.shape, bool))
    s, fixed, _ = structure_of(with_defaults(parse("lambert + phong")), 1)
    d = domains_of(s)
    data, target_norm_squared = blocked(part, "cbrt", np.ones(f.shape))
    problem = Problem(s, "cbrt", fixed, d, data, np.asarray(target_norm_squared))
    usual, refused = solver.sums, []

    def breaking(s, loss, p, fixed, data, active):
        total, scatter = usual(s, loss, p, fixed, data, active)
        off = p[:, 1] > 20.5
        refused.append(off.any())
        total.gradient[off], total.cost[off] = np.nan, np.nan
        return total, scatter

    monkeypatch.setattr(solver, "sums", breaking)
    starts = np.array([[0.1, 3.0, 0.1], [0.3, 19.0, 0.6]])
    ends = minimise(problem, np.stack([to_unconstrained(d, p) for p in starts]))
    assert any(refused) and ends.successful.all()
    np.testing.assert_allclose(ends.p, [[0.2, 20.0, 0.5]] * 2, rtol=1e-7)


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


def test_laid_out_directions_are_not_copied():
    shape = (PAGE, 64)
    laid = in_blocks(np.arange(1000.0), shape, 1.0)
    assert laid.ctypes.data % 64 == 0 and (laid.reshape(-1)[1000:] == 1.0).all()
    view = laid.reshape(-1)[:1000]
    assert in_blocks(view, shape).ctypes.data == laid.ctypes.data
    assert in_blocks(view[:-1].copy(), shape).ctypes.data != laid.ctypes.data


def test_a_model_without_a_finite_value_is_refused():
    from gonio.data import layouts
    from gonio.data.table import whole_table_of_values
    from gonio.fitting.fit_table import fit

    layout = layouts.in_plane(np.radians([10, 40]), np.radians([-30, 30]))
    masked_beyond_all_numbers = "1 * sgd(alpha=?, p=0.5, kappa=10, f0=0.5, f1=0, lam=3, c=1e120, k=15, theta_0=0)"
    with pytest.raises(GonioError, match="no finite value at any start"):
        fit(whole_table_of_values(layout, np.full(layout.shape, 0.1)), masked_beyond_all_numbers, loss="linear")
