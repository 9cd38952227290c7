"""Uncertainties where readings of an incidence err together: closed forms of a diffuser under a gain by incidence."""

import numpy as np
import pytest
from scipy.special import stdtrit

from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

INCIDENCES = 60
POLAR = np.radians(np.linspace(0, 75, INCIDENCES))
LAYOUT = layouts.isotropic(POLAR, POLAR[::6], np.radians(np.arange(0, 360, 45)))


def table_of(gain: float, noise: float) -> Table:
    rng = np.random.default_rng(7)
    drift = 1 + gain * rng.standard_normal(INCIDENCES).reshape(-1, 1, 1, 1)
    f = 0.1 * drift * (1 + noise * rng.standard_normal((*LAYOUT.shape, 1)))
    return whole_table_of_values(LAYOUT, f, channels=Channels.grey())


def relative_uncertainty(table: Table) -> tuple[float, list[str]]:
    result = fit(table, "lambert", loss="linear")
    (p,) = result.parameters
    return p.standard_uncertainty / p.value, result.notes


def test_a_gain_of_each_incidence_counts_as_many_times_as_there_are_incidences():
    """The mean of G gains has the relative uncertainty gain/√G, which 80 readings an incidence do not lower."""
    u, notes = relative_uncertainty(table_of(0.05, 0.01))
    # A variance from G squares is known to √(2/G); Student's quantile is 1.02 times the normal one.
    assert u == pytest.approx(0.05 / np.sqrt(INCIDENCES), rel=2 * np.sqrt(0.5 / INCIDENCES) + 0.02)
    assert any(f"{INCIDENCES} incidences" in note for note in notes)


def test_independent_noise_stays_what_it_is():
    u, notes = relative_uncertainty(table_of(0.0, 0.05))
    assert u == pytest.approx(0.05 / np.sqrt(LAYOUT.size), rel=0.1)
    assert not any("alike among neighbours" in note for note in notes)


@pytest.mark.parametrize("stated", [False, True])
def test_a_flicker_that_all_channels_share_counts_once(stated):
    """The mean of C channels that err together has the uncertainty σ/√n of one of them."""
    flicker = 1 + 0.05 * np.random.default_rng(3).standard_normal((*LAYOUT.shape, 1))
    f = 0.1 * np.broadcast_to(flicker, (*LAYOUT.shape, 8))
    known = {"u_f": np.full(f.shape, 0.005)} if stated else {}
    result = fit(whole_table_of_values(LAYOUT, f, channels=Channels.of_count(8), **known), "lambert(rho=shared)")
    (p,) = result.parameters
    # A variance from 64 parts is known to √(2/64); Student's quantile is 1.02 times the normal one.
    expected = 0.05 / np.sqrt(LAYOUT.size)
    assert p.standard_uncertainty / p.value == pytest.approx(expected, rel=2 * np.sqrt(0.5 / 64) + 0.02)
    assert any("channels are alike" in note for note in result.notes)


def test_a_number_that_one_incidence_alone_tells_of_is_not_known_to_independent_noise():
    """Of a Gaussian lobe that one incidence sees, nothing is told by the others: its scale may be anything near it."""
    theta = np.radians(np.append(np.linspace(0, 40, 20), 80.0))
    layout = layouts.isotropic(theta, np.radians(np.arange(60, 86, 2.5)), np.radians(np.arange(0, 360, 45)))
    lobe = np.asarray(evaluate(build("0.02 * beckmann(alpha=0.02)"), *layout.directions())).reshape(*layout.shape, 1)
    f = 0.1 * (1 + 0.05 * np.sin(9 * theta)).reshape(-1, 1, 1, 1) + lobe
    table = whole_table_of_values(layout, f, channels=Channels.grey())
    result = fit(table, "lambert + beckmann(alpha=0.02)", loss="linear")
    scale = next(p for p in result.parameters if p.name == "beckmann.scale")
    assert scale.value == pytest.approx(0.02, rel=1e-3) and scale.standard_uncertainty > 0.3 * scale.value


@pytest.mark.parametrize("number", [3, 12, 40])
def test_the_mean_of_few_readings_has_student_s_interval(number):
    """A diffuser's albedo is π times the mean: ± t s/√n at 95 %, in closed form."""
    rng = np.random.default_rng(number)
    polar = rng.uniform(0.1, 1.2, (2, number))
    layout = layouts.scattered(polar[0], np.zeros(number), polar[1], rng.uniform(0, 6, number))
    f = 0.1 * (1 + 0.05 * rng.standard_normal((number, 1)))
    (p,) = fit(whole_table_of_values(layout, f, channels=Channels.grey()), "lambert", loss="linear").parameters
    half = stdtrit(number - 1, 0.975) * np.std(f, ddof=1) / np.sqrt(number)
    np.testing.assert_allclose(p.interval95, np.pi * (np.mean(f) + half * np.array([-1, 1])), rtol=1e-6)
