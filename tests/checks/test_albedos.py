import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from gonio.checks.albedos import Albedos, energy_property, hemispherical, with_hemispherical
from gonio.checks.model.energy import incidences
from support.check_tables import property_of


@pytest.mark.parametrize(
    ("albedo", "truth"),
    [
        (lambda mu: 1 - mu * np.log(1 + 1 / mu), 4 / 3 * (1 - math.log(2))),
        (lambda mu: 2 * (1 - math.log(2)) / (1 + mu), 4 * (1 - math.log(2)) ** 2),
        (lambda mu: 0.3 + 0 * mu, 0.3),
    ],
)
@pytest.mark.parametrize("theta", [incidences(), np.radians(np.arange(0, 81, 10.0)), np.radians([10, 30, 50, 70.0])])
def test_the_claimed_interval_holds_the_closed_form(albedo, truth, theta):
    value, bound = hemispherical(theta, albedo(np.cos(theta))[:, None], np.zeros((theta.size, 1)))
    assert abs(value[0] - truth) <= bound[0] < max(0.3, 1 - theta[-1])


def test_monotone_cubics_are_those_of_another_library():
    rng = np.random.default_rng(2)
    for n in (4, 5, 9, 20):
        theta = np.sort(rng.uniform(0.05, 1.5, n))
        for e in (rng.random((n, 2)), np.round(rng.random((n, 2))), np.cumsum(rng.random((n, 2)), axis=0) / n):
            value, _ = hemispherical(theta, e, np.zeros((n, 2)))
            t = np.sin(np.round(theta, 9)) ** 2
            between = PchipInterpolator(t, e, axis=0).integrate(t[0], t[-1])
            np.testing.assert_allclose(value, between + t[0] * e[0] + (1 - t[-1]) * e[-1], rtol=1e-13)


def test_few_incidences_have_no_bound_and_errors_of_the_albedos_are_carried_on():
    assert np.isinf(hemispherical(np.array([0.1, 0.5]), np.ones((2, 1)), np.zeros((2, 1)))[1])
    theta = incidences()
    flat = np.full((theta.size, 2), 0.5)
    assert np.all(hemispherical(theta, flat, 0.01 * flat)[1] >= 0.005)


def test_the_certificate_states_the_albedo_under_uniform_light():
    energy = property_of("energy", "lambert(rho=[0.2, 0.6])")
    np.testing.assert_allclose(energy.facts["hemispherical_albedo"], [0.2, 0.6], rtol=1e-6)
    assert "uniform light" in energy.detail


@pytest.mark.parametrize(
    ("value", "bound", "verdict", "residual"),
    [
        ([1.5, 1.1], [9.0, 0.01], "fail", 0.1),
        ([1.0, 0.6], [np.inf, 0.01], "undecided", 0.0),
        ([0.9, 0.6], [0.0, 0.2], "pass", -0.1),
        ([np.nan, 0.6], [0.0, 0.2], "undecided", np.nan),
    ],
)
def test_the_verdict_takes_the_place_that_decides_it(value, bound, verdict, residual):
    value, bound = (np.array(a)[:, None] for a in (value, bound))
    energy = energy_property(Albedos(np.zeros(2), np.zeros(2), value, bound, bound, ""), 1e-6)
    assert energy.verdict == verdict and energy.residual == pytest.approx(residual, nan_ok=True)


def test_each_albedo_is_taken_from_the_way_that_bounds_it_more_closely():
    theta = np.radians([0, 40, 80.0])

    def way(value, bound, method):
        value, bound = (np.array(a)[:, None] for a in (value, bound))
        hidden = np.full((3, 2, 1), value[0, 0])
        return Albedos(theta, 0 * theta, value, bound, bound / 2, method, noise=bound / 10, hidden=hidden)

    model, readings = way([0.5, 0.6, 0.7], [9, 0.01, 0.01], "A."), way([0.51, 0.61, 0.71], [0.02, 0.01, np.inf], "B.")
    both = model.with_closer(readings)
    assert both.value.ravel() == pytest.approx([0.51, 0.6, 0.7]) and both.above.max() == 0.02
    assert both.below.ravel() == pytest.approx([0.01, 0.005, 0.005]) and both.hidden[0, 0] == 0.51
    assert "Readings alone bound 1 of the albedos" in both.method
    assert readings.with_closer(readings) is readings
    elsewhere = Albedos(theta + 0.1, *(getattr(readings, n) for n in ("phi_i", "value", "above", "below", "method")))
    assert model.with_closer(elsewhere) is model


def test_of_many_channels_the_certificate_states_the_ends():
    theta = incidences()
    e = np.linspace(0.2, 0.6, 300) + 0 * theta[:, None]
    known = Albedos(theta, 0 * theta, e, 0 * e, 0 * e, "closed form")
    detail = with_hemispherical(energy_property(known, 0.01), known).detail
    assert "0.2 (±" in detail and " to 0.6 (±" in detail and "in 300 of 300 channels" in detail and len(detail) < 500
    unknown = Albedos(theta, 0 * theta, e, 9 + 0 * e, 0 * e, "closed form")
    assert "not known in any of 300" in with_hemispherical(energy_property(unknown, 0.01), unknown).detail
