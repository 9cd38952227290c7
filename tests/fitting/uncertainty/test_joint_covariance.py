"""Covariance channel by channel against dense algebra on the whole Jacobian."""

import numpy as np
import pytest

from gonio.fitting.problem.arrow import WHOLE, Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains
from gonio.fitting.uncertainty.joint_covariance import JointEstimate

S, C, Q, N = 2, 20, 2, 30


class Rows:
    """Random rows (C, N, S + Q) with residuals; the dense Jacobian in a shuffled order of the numbers."""

    def __init__(self, rng, size=1e4, faint=()):
        self.rows = size * rng.normal(size=(C, N, S + Q))
        for channel in faint:
            self.rows[channel, :, S] = 1e-9 * size * self.rows[channel, :, S]
        self.residual = rng.normal(size=(C, N))
        self.order = rng.permutation(S + C * Q)
        self.p = np.full(self.order.size, 0.5)
        self.domains = Domains(np.zeros(self.p.size, int), np.zeros(self.p.size), np.ones(self.p.size))

    def dense(self):
        jacobian = np.zeros((C, N, self.p.size))
        jacobian[:, :, self.order[:S]] = self.rows[:, :, :S]
        for c in range(C):
            jacobian[c][:, self.order[S + c * Q : S + (c + 1) * Q]] = self.rows[c, :, S:]
        return jacobian.reshape(-1, self.p.size)

    def arrow(self, weight):
        squares = np.einsum("cng,cn,cnh->cgh", self.rows, weight, self.rows)
        return Arrow(squares[:, :S, :S].sum(0), squares[:, :S, S:], squares[:, S:, S:])

    def estimate(self, robust):
        gradient = (self.dense().T @ self.residual.ravel())[self.order]
        equations = NormalEquations(np.asarray(0.0), gradient, self.arrow(np.ones((C, N))))
        scores = self.arrow(self.residual**2) if robust else None
        return JointEstimate(equations, scores, C * N, self.domains, self.p, self.order)


def expected(rows, robust, free):
    """(JᵀJ)⁻¹, or White's sandwich with its factor n/(n − P)."""
    j = rows.dense()[:, free]
    inverse = np.linalg.inv(j.T @ j)
    if robust:
        score = (j * rows.residual.reshape(-1, 1)) * np.sqrt(C * N / (C * N - j.shape[1]))
        inverse = inverse @ (score.T @ score) @ inverse
    full = np.full((free.size, free.size), np.nan)
    full[np.ix_(free, free)] = inverse
    return full


@pytest.mark.parametrize("robust", [False, True])
def test_covariance_of_many_channels_is_that_of_dense_algebra(robust):
    """Every entry: of shared numbers, of a channel's own, and of two channels'; some numbers held."""
    rng = np.random.default_rng(3)
    rows = Rows(rng)
    assert rows.p.size > WHOLE
    free = rng.random(rows.p.size) < 0.8
    free[rows.order[1]] = False
    joint, full = rows.estimate(robust).covariance(free), expected(rows, robust, free)
    assert len(joint.views) == C
    scale = np.sqrt(np.outer(*[np.where(free, np.diagonal(full), 1.0)] * 2))
    np.testing.assert_allclose(joint.matrix() / scale, full / scale, atol=1e-10)
    np.testing.assert_allclose(joint.standard, np.sqrt(np.diagonal(full)), rtol=1e-10)
    assert not joint.undetermined.any() and not joint.combinations(rows.domains, rows.p)


def test_what_a_channel_leaves_open_is_its_own():
    """A number that its channel's readings hardly see is open, and no other; variances that grow open all."""
    rows = Rows(np.random.default_rng(4), size=1e3, faint=(5,))
    joint = rows.estimate(False).covariance(np.ones(rows.p.size, bool))
    (combination,) = joint.combinations(rows.domains, rows.p)
    assert combination.view.channel == 5
    np.testing.assert_array_equal(np.flatnonzero(joint.undetermined), [rows.order[S + 5 * Q]])
    assert joint.scaled(1e12, rows.domains, rows.p).undetermined.all()


def test_a_shared_number_that_own_ones_undo_is_open_in_all_channels():
    """The shared number does in every channel what that channel's own does: one combination, of all channels."""
    rows = Rows(np.random.default_rng(5))
    rows.rows[:, :, 0] = rows.rows[:, :, S] * 10 ** np.random.default_rng(6).uniform(-2, 2, (C, 1))
    joint = rows.estimate(False).covariance(np.ones(rows.p.size, bool))
    (combination,) = joint.combinations(rows.domains, rows.p)
    assert combination.variance == np.inf
    along = rows.dense() @ combination.change
    assert np.linalg.norm(along) < 1e-6 * np.linalg.norm(rows.dense() * combination.change)
    assert joint.undetermined[rows.order[0]]


def test_bounds_are_found_in_each_channel():
    """Numbers that the cost pushes against their bound stay there, whatever channel they are of."""
    rows = Rows(np.random.default_rng(7))
    held = np.zeros(rows.p.size, bool)
    held[rows.order[[S + 2, S + 11]]] = True
    joint, active, reach = rows.estimate(False).with_bounds(held, np.zeros_like(held))
    np.testing.assert_array_equal(active, held)
    np.testing.assert_array_equal(np.isnan(joint.variance), held)
    assert np.isfinite(reach[held]).all() and np.isnan(reach[~held]).all()
