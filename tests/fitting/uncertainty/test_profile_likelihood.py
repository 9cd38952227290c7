"""Profile intervals: where the cost is no parabola they are those of the likelihood itself."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar, nnls

from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.parameterisation import Domains, to_parameters, to_unconstrained
from gonio.fitting.uncertainty import profile_likelihood as profile
from gonio.fitting.uncertainty.optimum import NORMAL_95
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from support.fit_tables import free, table_of

SIGMA = 0.015


def few_readings(seed):
    """Twelve readings of a Lambertian with a broad lobe, in one plane."""
    angles = np.radians([[30.0] * 12, [0.0] * 12, np.linspace(5, 80, 12), [180.0] * 12])
    layout = layouts.scattered(*angles)
    f = np.asarray(evaluate(build("lambert(rho=0.3) + 0.2*ggx(alpha=0.5)"), *layout.directions()))
    noisy = f + SIGMA * np.random.default_rng(seed).standard_normal(f.shape)
    table = whole_table_of_values(layout, noisy[:, None], channels=Channels.grey(), u_f=np.full((12, 1), SIGMA))
    return layout, noisy, table


def test_ends_are_where_the_likelihood_says():
    """By a direct search: at each alpha the other two numbers follow from linear least squares, bounded at 0."""
    layout, y, table = few_readings(0)
    result = fit(table, "lambert + ggx", starts=4)
    alpha = free(result)["ggx.alpha"]
    assert result.converged and alpha.standard_uncertainty / alpha.value > 0.1

    def cost(a):
        lobe = np.asarray(evaluate(build(f"ggx(alpha={a})"), *layout.directions()))
        basis = np.stack([np.full(12, 1 / np.pi), lobe], axis=1) / SIGMA
        return 0.5 * nnls(basis, y / SIGMA)[1] ** 2

    best = minimize_scalar(cost, bounds=(0.5 * alpha.value, min(1.0, 2 * alpha.value)), method="bounded").fun
    grown = 2.0 * best / 9 if 2.0 * best / 9 > 1 + 5 * np.sqrt(2 / 9) else 1.0

    def above(a):
        return cost(a) - best - 0.5 * NORMAL_95**2 * grown

    for end, far in ((alpha.interval95[0], 0.2 * alpha.value), (alpha.interval95[1], 1.0)):
        expected = brentq(above, alpha.value, far) if above(far) > 0 else far
        assert end == pytest.approx(expected, rel=0.03)
    length = alpha.interval95[1] - alpha.interval95[0]
    assert length > 1.3 * 2 * NORMAL_95 * alpha.standard_uncertainty


def test_a_bent_valley_is_not_called_known():
    """η of a conductor from angles to 35°: the covariance at the minimum calls it known to 40 %, the data do not."""
    table = table_of("1*ggx(alpha=.3, eta=1.2, k=3)", noise=0.02)
    table.u_f = np.abs(0.02 * np.nan_to_num(table.f)) + 1e-12
    result = fit(table, "1 * ggx(eta=?, k=?)", theta_max=np.radians(40), starts=2)
    eta = free(result)["ggx.eta"]
    assert result.converged and eta.status == "undetermined"
    assert eta.interval95[0] <= 1.2 <= eta.interval95[1]
    assert eta.interval95[1] - eta.interval95[0] > 2 * 2 * NORMAL_95 * eta.standard_uncertainty


def test_a_spent_budget_is_said(monkeypatch):
    """Without evaluations to spend, vague numbers keep the covariance's intervals, and the result names them."""
    monkeypatch.setattr(profile, "BUDGET", -1)
    result = fit(few_readings(0)[2], "lambert + ggx", starts=4)
    alpha = free(result)["ggx.alpha"]
    assert any("ggx.alpha" in note and "come from the covariance matrix" in note for note in result.notes)
    low, high = (alpha.value + s * NORMAL_95 * alpha.standard_uncertainty for s in (-1, 1))
    assert alpha.interval95 == pytest.approx((low, min(1.0, high)))


def test_a_domain_of_one_value_holds_its_number():
    domains = Domains(np.array([0, 1, 2]), np.array([0.2, 0.3, 0.4]), np.array([0.2, 0.3, 0.4]))
    p, slope, _ = to_parameters(domains, to_unconstrained(domains, np.array([0.2, 0.3, 0.4])), np)
    np.testing.assert_array_equal(p, [0.2, 0.3, 0.4])
    np.testing.assert_array_equal(slope, 0.0)


RISES = {
    "a parabola": lambda x: x,
    "steep from far on": lambda x: x + 50 * np.maximum(x - 0.8, 0) ** 2,
    "a wall": lambda x: 0.3 * x + 40 * np.maximum(x - 1.5, 0),
    "slowing down": lambda x: 2 * np.sqrt(x) / (1 + 0.1 * x),
    "a threshold": lambda x: 5 * x**8,
}


@pytest.mark.parametrize("rise", RISES.values(), ids=RISES)
@pytest.mark.parametrize("first", [0.02, 1.0, 30.0])
def test_a_search_ends_where_the_profile_has_risen_by_what_is_allowed(rise, first):
    """Of profiles of any shape, from far too near and far too far, without the last of its trials."""
    start = [profile._Fit(0.0, 0.0, np.zeros(1))]
    search = profile._Search(0, 1.0, 2.0, 0.7, np.ones(1), 0.0, 1e6, first, start)
    while not search.done:
        reached = 2.0 * rise(search.distance)
        search.learn(np.array([search.trial]), 0.7 * reached**2)
    expected = brentq(lambda x: rise(x) - 1.0, 0.0, 30.0)
    assert rise(search.end) == pytest.approx(1.0, abs=2 * profile.CLOSE) or search.end == pytest.approx(
        expected, rel=0.03
    )
    farther = search.farther(3.0)
    assert farther.within[1] < 1.0 and (farther.beyond is None or farther.beyond[1] >= 1.0)
    assert farther.distance > farther.within[0]
