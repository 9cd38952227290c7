"""Arrows against the same matrices in full: by NumPy's dense algebra, in NumPy and in JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.fitting.problem.arrow import Arrow, solve_by_elimination


def arrow(rng, shared, channels, own, lead=(2,)):
    """A positive definite arrow, from rows that see the shared numbers and one channel's."""
    rows = rng.normal(size=(*lead, channels, 9, shared + own))
    squares = rows.swapaxes(-1, -2) @ rows
    s = slice(shared)
    return Arrow(squares[..., s, s].sum(-3), squares[..., s, shared:], squares[..., shared:, shared:])


SIZES = [(2, 5, 3), (0, 4, 2), (3, 4, 1), (2, 3, 0)]


@pytest.mark.parametrize("sizes", SIZES)
def test_algebra_is_that_of_the_whole_matrix(sizes):
    rng = np.random.default_rng(sum(sizes))
    a = arrow(rng, *sizes)
    v, whole = rng.normal(size=(2, a.sizes.total)), a.whole()
    np.testing.assert_array_equal(whole, whole.swapaxes(1, 2))
    np.testing.assert_allclose(a.mv(v), (whole @ v[..., None])[..., 0], rtol=1e-12)
    np.testing.assert_allclose(a.solved(v), np.linalg.solve(whole, v[..., None])[..., 0], rtol=1e-9)
    np.testing.assert_array_equal(a.diagonal(), np.diagonal(whole, axis1=1, axis2=2))
    np.testing.assert_allclose(a.scaled(v).whole(), whole * v[:, :, None] * v[:, None, :], rtol=1e-12)
    np.testing.assert_allclose(a.plus_diagonal(v).whole(), whole + v[:, :, None] * np.eye(v.shape[1]), rtol=1e-12)
    kept = rng.random(v.shape[1]) < 0.6
    np.testing.assert_array_equal(a.restricted(kept).whole()[:, ~kept], np.eye(kept.size)[None, ~kept].repeat(2, 0))


@pytest.mark.parametrize("sizes", SIZES[:1])
def test_compiled_algebra_is_the_same(sizes):
    rng = np.random.default_rng(1)
    a = arrow(rng, *sizes, lead=())
    v = rng.normal(size=a.sizes.total)

    @jax.jit
    def compiled(a, v):
        changed = a.scaled(v).plus_diagonal(v**2)
        return changed.solved(v), changed.mv(v)

    plain = a.scaled(v).plus_diagonal(v**2)
    solved, product = compiled(jax.tree.map(jnp.asarray, a), jnp.asarray(v))
    np.testing.assert_allclose(solved, plain.solved(v), rtol=1e-9)
    np.testing.assert_allclose(product, plain.mv(v), rtol=1e-12)


def test_a_matrix_of_which_nothing_is_known_is_an_arrow():
    matrix = np.array([[2.0, 1.0], [1.0, 3.0]])
    a = Arrow.dense(matrix)
    np.testing.assert_array_equal(a.whole(), matrix)
    np.testing.assert_allclose(a.solved(np.ones(2)), np.linalg.solve(matrix, np.ones(2)), rtol=1e-14)


def test_what_is_not_positive_definite_has_no_solution():
    matrix = np.array([[[1.0, 2.0], [2.0, 1.0]], [[2.0, 0.0], [0.0, 4.0]]])
    solved = solve_by_elimination(matrix, np.ones((2, 2, 1)))
    assert np.isnan(solved[0]).all()
    np.testing.assert_allclose(solved[1, :, 0], [0.5, 0.25])
